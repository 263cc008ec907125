"""The minutes of a session with slopes, estimated once and then known to `report`, `check` and `estimate`.

A minute has two parts: what was measured and noticed, which the cache keeps by everything the minute bins
depend on, and the slopes of one set of settings, which are those of `estimate`. Both are found again by the
checksum of the file, so that a changed session is read and estimated anew.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import islice

import numpy as np

from fieldkit.config import Config
from fieldkit.disk import sha256
from fieldkit.estimation.binner import Binner
from fieldkit.estimation.bins import History
from fieldkit.estimation.estimator import Minute, measured_minute
from fieldkit.estimation.settings import EstimatorSettings, Model
from fieldkit.model.device import StreamInfo
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.site import RegionKind, Site
from fieldkit.sessions.json_forms import build
from fieldkit.sessions.reader import SessionReader
from fieldkit.workflows.batch import Run, bin_settings, estimate_run
from fieldkit.workflows.bins_and_slopes import closed_minutes, estimate
from fieldkit.workflows.cache import Arrays, Cache, digest
from fieldkit.workflows.session_estimates import Estimates
from fieldkit.workflows.sources import Source, regions_for

FINISHED = ("sealed", "recovered")
"""States in which a session changes no more, so that what is known of it stays true."""


@dataclass(frozen=True)
class _Measured:
    """Minutes without slopes, their bins, and how many samples of each stream were damaged."""

    minutes: tuple[Minute, ...]
    history: History
    damaged: Mapping[str, int]


class KnownMinutes:
    """The minutes of a session by one configuration, with slopes by any model.

    `streams` are those that take part, all of the session unless given. `damaged` counts the samples that do
    not match their checksum, by stream.
    """

    def __init__(
        self,
        session: SessionReader,
        config: Config,
        *,
        present: bool = False,
        streams: Sequence[StreamInfo] = (),
    ) -> None:
        self.site: Site = config.site
        self.settings: EstimatorSettings = config.estimator_settings()
        self.schedule: RegionSchedule = regions_for(session, config, present=present)
        self._session = session
        self._streams = tuple(streams or session.streams.values())
        self._cache = Cache() if session.state in FINISHED and session.path.exists() else None
        checksum = "" if self._cache is None else sha256(session.path)
        self._source = Source(session.path, checksum, session.session_id, config, self.schedule)
        self._measured = self._known()

    @property
    def damaged(self) -> Mapping[str, int]:
        """Samples that do not match their checksum, by stream."""
        return self._measured.damaged

    def minutes(self, model: Model | None = None) -> list[Minute]:
        """All minutes with slopes by a model, that of the settings unless given."""
        run = self._run(replace(self.settings, model=model or self.settings.model))
        found = self._estimates(run)
        slopes, learnt = iter(found), found.learnt.by_time_ns
        minutes = zip(self._measured.minutes, self._measured.history.minute.tolist(), strict=True)
        return [
            replace(
                one,
                estimates=tuple(islice(slopes, self._targets(minute))),
                learnt=learnt.get(one.time_ns),
            )
            for one, minute in minutes
        ]

    def _targets(self, minute: int) -> int:
        return sum(region.kind is RegionKind.TARGET for region in self.schedule.regions_at(minute))

    def _run(self, settings: EstimatorSettings) -> Run:
        return Run(self._source, self.site, settings)

    def _estimates(self, run: Run) -> Estimates:
        """Slopes from the cache or from the bins; those of some streams alone are kept nowhere."""
        if self._cache is None or len(self._streams) < len(self._session.streams):
            return estimate(self._measured.history, self.schedule, run.settings)
        return estimate_run(run, self._cache)

    def _known(self) -> _Measured:
        if self._cache is None:
            return self._read()
        run, names = self._run(self.settings), [stream.name for stream in self._streams]
        key, entry = digest("minutes", run.bins_key, names), None
        if (entry := self._cache.load(key)) is not None:
            return _unpacked(entry)
        found = self._read()
        self._cache.store(key, _packed(found))
        if len(names) == len(self._session.streams):
            self._cache.store(run.bins_key, found.history.arrays())
        return found

    def _read(self) -> _Measured:
        """Read the session once."""
        binner = Binner(self.site, self.schedule, self._streams, bin_settings(self.settings))
        (closed,) = closed_minutes(self._session, [binner])
        schedule, words = binner.schedule, binner.irradiance_model
        minutes = tuple(measured_minute(one, schedule, words) for one in closed)
        return _Measured(minutes, History.of([one for one, _ in closed]), dict(self._session.damaged))


def _packed(found: _Measured) -> Arrays:
    """As arrays, every number exact."""
    texts = [json.dumps(asdict(one)) for one in found.minutes]
    damaged = json.dumps(dict(found.damaged))
    return {
        "minutes": np.array(texts, np.bytes_),
        "damaged": np.array([damaged], np.bytes_),
        **found.history.arrays(),
    }


def _unpacked(entry: Arrays) -> _Measured:
    minutes = tuple(build(Minute, json.loads(text)) for text in entry["minutes"].tolist())
    damaged = json.loads(entry["damaged"].tolist()[0])
    return _Measured(minutes, History(**{one.name: entry[one.name] for one in fields(History)}), damaged)
