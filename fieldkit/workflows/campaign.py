"""A campaign: create its folder, open it, add regions, estimate its sessions with other parameters.

>>> campaign = fieldkit.open_campaign("sandslope")          # doctest: +SKIP
>>> for session in campaign.sessions:                       # doctest: +SKIP
...     session.estimate(albedo=0.25).to_frame()
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

from fieldkit.config import (
    FILE_NAME,
    Config,
    ConfigMistakesError,
    find_campaign,
    load_config,
    mistakes_in,
)
from fieldkit.config.template import PAPER_SITE, SIMULATED, campaign_toml
from fieldkit.model.errors import ConfigError, RefusedError, StorageError
from fieldkit.model.site import zone_by_longitude
from fieldkit.sessions.reader import Session, open_session
from fieldkit.workflows.batch import estimate_run, run_of
from fieldkit.workflows.cache import Cache
from fieldkit.workflows.estimates import Estimates
from fieldkit.workflows.executors import Workers
from fieldkit.workflows.regions import Point, Rect, RegionProperties, add_region
from fieldkit.workflows.sources import Source, settings_from, source_of
from fieldkit.workflows.sweep import Sweep, sweep

FOLDERS = ("calibration", "recordings", "results", "reports")
GITIGNORE = (
    "# Sessions are large; keep the configuration and the calibrations.\n/recordings/\n/results/\n/reports/\n"
)


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


@dataclass
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

    def add_region(
        self,
        name: str,
        *,
        points: Sequence[Point] = (),
        rect: Rect | None = None,
        reference: bool = False,
        **properties: Unpack[RegionProperties],
    ) -> None:
        """Add a region to ``fieldkit.toml`` and to `config`; parameters and errors as `regions.add_region`.

        >>> campaign.add_region("b15", rect=(60, 60, 30, 30), tilt_deg=15)  # doctest: +SKIP
        """
        add_region(self.config.path, name, points=points, rect=rect, reference=reference, **properties)
        self.config = load_config(self.config.path)

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
    """Open the campaign in a folder or around it; raises `ConfigError` if there is none."""
    return Campaign(load_config(find_campaign(Path(path))))


def init_campaign(
    folder: str | Path,
    site: tuple[float, float] | tuple[float, float, float] | None = None,
    *,
    timezone: str | None = None,
    simulated: bool = False,
) -> Campaign:
    """Create a campaign folder: a commented ``fieldkit.toml`` and folders for its files.

    Parameters
    ----------
    folder
        Created if needed; it must not contain a ``fieldkit.toml``.
    site
        Latitude [degrees north], longitude [degrees east] and elevation [m]. The paper's site by default.
    timezone
        IANA name, such as ``Asia/Tokyo``; by default whole hours by the longitude.
    simulated
        A campaign that records on simulated devices, with a site of its own.

    Raises
    ------
    ConfigError
        The site or its time zone is invalid; nothing is written.
    RefusedError
        The folder is a campaign already.
    StorageError
        The folder cannot be written.
    """
    if simulated and (site or timezone):
        raise ConfigError("a simulated campaign brings its own site: omit site and timezone")
    if timezone and site is None:
        raise ConfigError("a time zone needs a site")
    if simulated:
        return create_campaign(folder, SIMULATED)
    return create_campaign(folder, {"site": PAPER_SITE if site is None else _site_table(site, timezone)})


def create_campaign(folder: str | Path, tables: Mapping[str, Any]) -> Campaign:
    """Create a campaign folder with these tables of ``fieldkit.toml``; raises as `init_campaign`."""
    file = Path(folder) / FILE_NAME
    text = campaign_toml(tables)
    if mistakes := mistakes_in(text, file):
        raise ConfigMistakesError(mistakes, fix="nothing was written; correct the options")
    if file.exists():
        raise RefusedError(
            f"{file} is there already", fix="choose another folder; init never overwrites a campaign"
        )
    try:
        for name in FOLDERS:
            (file.parent / name).mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        ignore = file.parent / ".gitignore"
        if not ignore.exists():
            ignore.write_text(GITIGNORE, encoding="utf-8")
    except OSError as error:
        raise StorageError(f"cannot make a campaign in {folder}: {error.strerror}") from error
    return Campaign(load_config(file))


def _site_table(site: Sequence[float], timezone: str | None) -> Mapping[str, Any]:
    latitude_deg, longitude_deg = site[:2]
    return {
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "elevation_m": site[2] if len(site) > 2 else 0.0,
        "timezone": timezone or zone_by_longitude(longitude_deg),
    }
