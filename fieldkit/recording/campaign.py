"""A campaign: create its folder, open it, add regions, estimate its sessions with other parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack, overload

from fieldkit.config import (
    FILE_NAME,
    Config,
    ConfigMistakesError,
    find_campaign,
    load_config,
    mistakes_in,
)
from fieldkit.config.edit import editing
from fieldkit.config.template import PAPER_SITE, SIMULATED, campaign_toml
from fieldkit.drivers.instrument import Instrument
from fieldkit.model.door import checked
from fieldkit.model.errors import ConfigError, RefusedError, SessionError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import Region, zone_by_longitude
from fieldkit.model.spelling import did_you_mean
from fieldkit.phrases import counted
from fieldkit.recording.adding import AddedDevices, Ask, Question, Stated, add_devices
from fieldkit.recording.opening import open_instruments
from fieldkit.recording.recordings import sessions_in
from fieldkit.recording.regions import Point, Rect, RegionProperties, add_region
from fieldkit.results.result_files import writing
from fieldkit.results.session import Session, open_session
from fieldkit.results.sources import Settings, settings_from
from fieldkit.results.sweep import Sweep, sweep
from fieldkit.views import formatting, html

FOLDERS = ("calibration", "recordings", "results", "reports")
GITIGNORE = (
    "# Sessions are large; keep the configuration and the calibrations.\n/recordings/\n/results/\n/reports/\n"
)


class Sessions(Sequence[Session]):
    """The recordings of a campaign, oldest first; each is opened when it is asked for.

    Examples
    --------
    >>> len(campaign.sessions)
    1
    >>> campaign.sessions[-1].name
    '20160101T190001Z-noon'
    """

    def __init__(self, paths: Iterable[Path]) -> None:
        self.paths: tuple[Path, ...] = tuple(paths)

    def __len__(self) -> int:
        return len(self.paths)

    @overload
    def __getitem__(self, index: int) -> Session: ...
    @overload
    def __getitem__(self, index: slice) -> Sessions: ...
    def __getitem__(self, index: int | slice) -> Session | Sessions:
        if isinstance(index, slice):
            return Sessions(self.paths[index])
        return open_session(self.paths[index])

    def __repr__(self) -> str:
        return f"<{counted(len(self), 'session')}: {', '.join(path.stem for path in self.paths)}>"


@checked
@dataclass
class Campaign:
    """A campaign folder: its configuration as it is now, and its recordings by age.

    `settings` are ``KEY=VALUE`` that replace values of ``fieldkit.toml`` while this object is used.

    Examples
    --------
    >>> campaign
    <Campaign sand slopes under the sky of Alamosa, simulated: 4 regions, 1 session>
    >>> [region.name for region in campaign.regions]
    ['flat', 'b05', 'b15', 'b25']
    >>> campaign["noon"].state
    'sealed'
    """

    config: Config
    settings: tuple[str, ...] = ()

    @property
    def directory(self) -> Path:
        """Path of ``fieldkit.toml``."""
        return self.config.directory

    @property
    def sessions(self) -> Sessions:
        """The recordings, oldest first."""
        return Sessions([path for path in sessions_in(self.config.recordings) if path.exists()])

    def __getitem__(self, name: str) -> Session:
        """The session of that name, or the latest one recorded with ``name=`` so.

        Raises
        ------
        SessionError
            Where there is none; it lists those there are.
        """
        paths = self.sessions.paths
        matches = [path for path in paths if path.stem == name or path.stem.endswith(f"-{name}")]
        if not matches:
            fix = did_you_mean(name, (path.stem for path in paths))
            raise SessionError(f"no session {name!r}", place=self.directory, fix=fix)
        return open_session(matches[-1])

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions as ``fieldkit.toml`` has them now."""
        return self.config.regions

    def __repr__(self) -> str:
        what = f"{counted(len(self.regions), 'region')}, {counted(len(self.sessions), 'session')}"
        return f"<Campaign {self.config.tables.campaign.title or self.directory.name}: {what}>"

    def _repr_html_(self) -> str:
        rows = [
            (region.name, region.kind.name.lower(), formatting.given_slope(region)) for region in self.regions
        ]
        caption = f"{self.directory}: {counted(len(self.sessions), 'session')}"
        return html.table_html(html.Table(("region", "kind", "tilt/azimuth"), rows, caption))

    def add_region(
        self,
        name: str,
        *,
        points: Sequence[Point] = (),
        rect: Rect | None = None,
        is_ground: bool = False,
        **properties: Unpack[RegionProperties],
    ) -> None:
        """Add a region to ``fieldkit.toml`` and to `config`; parameters and errors as `regions.add_region`.

        Examples
        --------
        >>> dunes = fieldkit.init_campaign("dunes")
        >>> dunes.add_region("flat", rect=(10, 60, 30, 30), kind="reference")
        >>> dunes.add_region("slope", rect=(60, 60, 30, 30), tilt_deg=15.0, azimuth_deg=180.0)
        >>> [region.name for region in dunes.regions]
        ['flat', 'slope']
        """
        with editing(self.config.path) as draft:
            add_region(draft, name, points=points, rect=rect, is_ground=is_ground, **properties)
        self.config = load_config(self.config.path, settings=self.settings)

    def add_devices(
        self, stated: Stated | None = None, ask: Ask = Question.accept, addresses: Sequence[str] = ()
    ) -> AddedDevices:
        """Write what is connected into ``fieldkit.toml``; parameters and errors as `adding.add_devices`.

        Examples
        --------
        >>> dunes = fieldkit.init_campaign("dunes", (37.70, -105.92))
        >>> dunes.add_devices({"10c4:ea60:A7": {"driver": "lutron"}})
        <AddedDevices: lux; 0 configured, 0 failed>
        """
        devices = add_devices(self.config.path, stated, ask, addresses)
        self.config = load_config(self.config.path, settings=self.settings)
        return devices

    @contextmanager
    def open_devices(self) -> Iterator[dict[str, Instrument[Any]]]:
        """The campaign's instruments by name, open to be read by hand; closed at the end.

        Raises as `fieldkit.record`.

        Examples
        --------
        >>> with campaign.open_devices() as devices:
        ...     devices["lux"].read().unit
        'lx'
        """
        with open_instruments(self.config) as opened, opened.clock.taking_part():
            yield {device.info.name: Instrument(device) for device in opened.devices}

    def sweep(
        self,
        parameters: Mapping[str, Sequence[Any]],
        /,
        *,
        sessions: Iterable[Session | str | Path] | None = None,
        executor: Executor | None = None,
    ) -> Sweep:
        """Estimate sessions with every combination of parameters; what was estimated before is cached.

        Parameters
        ----------
        parameters
            Values to try by key, as in `fieldkit.estimate`:
            ``{"albedo": [0.15, 0.20, 0.25], "estimator.model": ["paper", "full"]}``.
        sessions
            Sessions or their files, of this campaign or of others; all of this one if not given.
        executor
            Any of `concurrent.futures`, whose workers estimate; this process unless given.

        Raises
        ------
        ConfigError
            For a key or value that no estimate has.

        Examples
        --------
        >>> campaign.sweep({"albedo": [0.20, 0.25], "estimator.model": ["paper", "full"]})
        <Sweep of 4 sets, 1 session; best: surface.albedo = 0.2, estimator.model = full>
        """
        chosen = self.sessions.paths if sessions is None else sessions
        paths = [session.path if isinstance(session, Session) else session for session in chosen]
        return sweep(paths, parameters, executor=executor)


def open_campaign(path: str | Path = ".", settings: Settings = ()) -> Campaign:
    """Open the campaign in a folder or around it; raises `ConfigError` if there is none.

    `settings` are other values for keys of ``fieldkit.toml``, which itself stays as it is:
    ``{"simulation.speed": "max"}``.

    Examples
    --------
    >>> darker = fieldkit.open_campaign("sandslope", {"surface.albedo": 0.25})
    >>> darker.config.tables.surface.albedo
    0.25
    """
    overrides = tuple(settings_from(settings))
    return Campaign(load_config(find_campaign(Path(path)), settings=overrides), overrides)


def init_campaign(
    folder: str | Path,
    site: tuple[float, float] | tuple[float, float, float] | None = None,
    *,
    timezone: str | None = None,
    simulated: bool = False,
    tables: Mapping[str, Mapping[str, Any]] | None = None,
) -> Campaign:
    """Create a campaign folder: a short ``fieldkit.toml`` and folders for its files.

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
    tables
        Further tables of ``fieldkit.toml``, such as ``{"surface": {"same": True}}`` for beds of one heap.

    Raises
    ------
    ConfigError
        The site or its time zone is invalid; nothing is written.
    RefusedError
        The folder is a campaign already.
    StorageError
        The folder cannot be written.

    Examples
    --------
    >>> dunes = fieldkit.init_campaign("dunes", (37.70, -105.92, 2317.0), timezone="America/Denver")
    >>> dunes.config.site.timezone
    'America/Denver'
    """
    if simulated and (site or timezone):
        raise ConfigError(
            "brings its own site",
            place=Argument("simulated"),
            fix="omit " + Argument("site") + " and " + Argument("timezone"),
        )
    if timezone and site is None:
        raise ConfigError("needs a site", place=Argument("timezone"), fix=Argument("site"))
    if simulated:
        return create_campaign(folder, {**SIMULATED, **(tables or {})})
    place = PAPER_SITE if site is None else _site_table(site, timezone)
    return create_campaign(folder, {"site": place, **(tables or {})})


def create_campaign(folder: str | Path, tables: Mapping[str, Any]) -> Campaign:
    """Create a campaign folder with these tables of ``fieldkit.toml``; raises as `init_campaign`."""
    file = Path(folder) / FILE_NAME
    text = campaign_toml(tables)
    if mistakes := mistakes_in(text, file):
        raise ConfigMistakesError(mistakes, fix="correct the options: nothing was written")
    if file.exists():
        raise RefusedError(
            "there already", place=file, fix="choose another folder; init never overwrites a campaign"
        )
    with writing(file):
        for name in FOLDERS:
            (file.parent / name).mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        ignore = file.parent / ".gitignore"
        if not ignore.exists():
            ignore.write_text(GITIGNORE, encoding="utf-8")
    return Campaign(load_config(file))


def _site_table(site: Sequence[float], timezone: str | None) -> Mapping[str, Any]:
    latitude_deg, longitude_deg = site[:2]
    return {
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "elevation_m": site[2] if len(site) > 2 else 0.0,
        "timezone": timezone or zone_by_longitude(longitude_deg),
    }
