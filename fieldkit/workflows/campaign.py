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

import tomlkit

from fieldkit.config import Config, find_campaign, load_config
from fieldkit.config.toml_schema import known_keys
from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.sessions.reader import Session, open_session
from fieldkit.workflows.batch import Failure, carried_out, run_of
from fieldkit.workflows.cache import Cache
from fieldkit.workflows.estimates import Estimates
from fieldkit.workflows.executors import local
from fieldkit.workflows.sources import Source, source_of
from fieldkit.workflows.sweep import Grid, Parameter, Summary, Sweep, names_of, runs_of

TABLES = ("surface", "air", "irradiance", "estimator", "slab", "site")
"""Tables of ``fieldkit.toml`` whose keys enter an estimate."""


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
        keys = {**(settings or {}), **{qualified_key(name): value for name, value in values.items()}}
        run = run_of(self.source, [f"{key}={tomlkit.item(value).as_string()}" for key, value in keys.items()])
        with local(1) as executor:
            (outcome,) = carried_out([run], executor, self.cache)
        if isinstance(outcome, Failure):
            raise outcome.error
        return outcome.estimates


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
        grid = Grid(tuple(_parameter(key, values) for key, values in parameters.items()))
        failures: dict[Path, FieldkitError] = {}
        sources: list[Source] = []
        for session in self.sessions if sessions is None else sessions:
            try:
                sources.append(session.source)
            except FieldkitError as error:
                failures[session.path] = error
        summary = Summary(grid, names_of(sources))
        with local(jobs) as executor:
            for outcome in carried_out(runs_of(sources, grid), executor, Cache()):
                if isinstance(outcome, Failure):
                    failures[outcome.run.source.path] = outcome.error
                else:
                    summary.add(outcome)
        return Sweep(grid, summary.columns(), summary.ranking(), failures)


def open_campaign(path: str | Path = ".") -> Campaign:
    """Open the campaign in a folder or around it; raises `ConfigError` where there is none."""
    return Campaign(load_config(find_campaign(Path(path))))


def _parameter(name: str, values: Sequence[Any]) -> Parameter:
    """A key and its values as ``fieldkit.toml`` would have them."""
    key = name if "." in name else qualified_key(name)
    if isinstance(values, str) or not len(values):
        raise ConfigError(f"{key}: {values!r} is not a list of values", fix="write it as [0.15, 0.20, 0.25]")
    plain = [value.item() if hasattr(value, "item") else value for value in values]  # of a numpy array
    written = [value if isinstance(value, str) else tomlkit.item(value).as_string() for value in plain]
    return Parameter(key, tuple(dict.fromkeys(written)))


def qualified_key(name: str) -> str:
    """``surface.albedo`` of ``albedo``; raises `ConfigError` where no table or more than one has it."""
    found = [f"{table}.{name}" for table in TABLES if name in known_keys((table,))]
    if len(found) == 1:
        return found[0]
    if found:
        raise ConfigError(f"{name} is ambiguous", fix=f'say which: estimate({{"{found[0]}": ...}})')
    raise ConfigError(f"no parameter is called {name}", fix="see the configuration reference for the keys")
