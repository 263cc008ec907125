"""``fieldkit.open_campaign``: the sessions of a campaign, and their slopes with other parameters.

>>> campaign = fieldkit.open_campaign("sandslope")          # doctest: +SKIP
>>> for session in campaign.sessions:                       # doctest: +SKIP
...     session.estimate(albedo=0.25).to_frame()
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from fieldkit.config import Config, find_campaign, load_config
from fieldkit.sessions.reader import Session, open_session
from fieldkit.workflows.batch import estimate_run, run_of
from fieldkit.workflows.cache import Cache
from fieldkit.workflows.estimates import Estimates
from fieldkit.workflows.executors import Workers
from fieldkit.workflows.sources import Source, settings_from, source_of
from fieldkit.workflows.sweep import Sweep, sweep


@dataclass(frozen=True)
class CampaignSession:
    """A recording of a campaign: `path` of its file; `open` reads it, `estimate` works out slopes."""

    path: Path
    cache: Cache = field(default_factory=Cache, repr=False)

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    @cached_property
    def source(self) -> Source:
        """What is estimated; read at the first estimate."""
        return source_of(self.path)

    def open(self) -> Session:
        """The session, for reading samples and events; a context manager."""
        return open_session(self.path)

    def estimate(self, settings: Mapping[str, Any] | None = None, /, **values: Any) -> Estimates:
        """Slopes minute by minute, as the session was configured or with other parameters.

        Keys of ``fieldkit.toml``: by their own name where only one table has it
        (``albedo=0.25``), else in full (``{"estimator.diffuse_fraction": 0.2}``). What was
        estimated before comes from the cache. Raises `ConfigError`, `SessionError`.
        """
        return estimate_run(run_of(self.source, settings_from({**(settings or {}), **values})), self.cache)


@dataclass(frozen=True)
class Campaign:
    """A campaign folder: its configuration as it is now, and its recordings by age."""

    config: Config

    @property
    def directory(self) -> Path:
        """Where ``fieldkit.toml`` is."""
        return self.config.directory

    @cached_property
    def sessions(self) -> tuple[CampaignSession, ...]:
        """The recordings, oldest first."""
        return tuple(CampaignSession(path) for path in sorted(self.config.recordings.glob("*.h5")))

    def sweep(
        self,
        parameters: Mapping[str, Sequence[Any]],
        /,
        *,
        sessions: Iterable[CampaignSession] | None = None,
        jobs: int = 1,
    ) -> Sweep:
        """Estimate sessions with every combination of parameters; what was estimated before is cached.

        Parameters
        ----------
        parameters
            Values to try by key, as in `CampaignSession.estimate`:
            ``{"albedo": [0.15, 0.20, 0.25], "estimator.model": ["paper", "full"]}``.
        sessions
            Of this campaign or of others; all of this one if not given.
        jobs
            Processes to work with.

        Raises
        ------
        ConfigError
            For a key or value that no estimate has.
        """
        chosen = self.sessions if sessions is None else sessions
        return sweep([session.path for session in chosen], parameters, workers=Workers(jobs))


def open_campaign(path: str | Path = ".") -> Campaign:
    """Open the campaign in a folder or around it; raises `ConfigError` where there is none."""
    return Campaign(load_config(find_campaign(Path(path))))
