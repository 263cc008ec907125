"""Recordings of other programs become sessions, or join one: frames, tables of loggers, weather stations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, fields, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple
from zoneinfo import ZoneInfo

from fieldkit.config import Config, NoCampaignError, find_campaign, load_config
from fieldkit.config.template import PAPER_SITE
from fieldkit.estimation.instruments import sunlight_source
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.door import checked
from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.model.limits import changed_rows
from fieldkit.model.next_step import Action, Argument, Sentence
from fieldkit.model.quantities import COMPONENTS
from fieldkit.model.samples import Severity
from fieldkit.model.site import Site, apart_m, known_zone
from fieldkit.results import import_flir
from fieldkit.results.json_document import attributes
from fieldkit.results.session import Session, open_session
from fieldkit.results.sources import SessionOrFile, configured_otherwise, log_warning, reading
from fieldkit.sessions.formats import imported, jma, merged, stills
from fieldkit.sessions.formats.bags import is_bag, read_bag
from fieldkit.sessions.formats.containers import is_container
from fieldkit.sessions.formats.frame_tables import is_frame_table
from fieldkit.sessions.formats.imported import ImportedRecording, MissingOptionsError, UnstatedZoneError
from fieldkit.sessions.formats.logger_clock import Keep
from fieldkit.sessions.formats.logs import read_log
from fieldkit.sessions.formats.merged import SAME_PLACE_M, Alignment, align, cut_session, merge
from fieldkit.sessions.formats.purethermal_files import is_purethermal, read_purethermal
from fieldkit.sessions.formats.stations import read_station
from fieldkit.sessions.formats.tables import LogOptions
from fieldkit.sessions.formats.unread import refuse_unread
from fieldkit.sessions.layout import SessionHeader, is_stream_name
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.seal import SealReport
from fieldkit.weather import is_station_file

AUTO: Literal["auto"] = "auto"
_OFFSET = Argument("offset_s")
TABLES = (".csv", ".txt", ".tsv", ".dat")
_NO_SITE = MissingOptionsError(
    "where this was recorded is not known, and slopes need it",
    fix="give its " + Argument("site") + ", or run this inside a campaign",
)


@checked
@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Facts that an imported recording does not state itself.

    An option that its format does not use is refused. Raises `ConfigError` for a value that no recording has.

    Parameters
    ----------
    name : str, optional
        Name of the stream; ``camera``, ``station`` or ``logger`` by default.
    title : str
        Title of the session; the source's name by default.
    site : Site, optional
        Where it was recorded; by default as the recording states, or else the campaign's.
    kelvin_per_count, kelvin_at_zero : float
        Scale of TIFF, PNG or IRG frames; NaN if it is not known. Never guessed. [K]
    times : Path, optional
        Table of the frames' file names and times.
    time_format : str, optional
        Format of times in the frames' names or in a table, such as ``%Y%m%dT%H%M%S``.
    zone : str, optional
        IANA time zone of times that have none.
    offset_s : float or "auto"
        Seconds to add to the times of frames, of a table or of a session, if their clock was slow; ``auto``
        finds those of a table from the session it is merged into. Those of a session are found where none are
        given.
    unit : str
        Unit of a table's values where it states none; of frames of floating-point temperatures.
    columns : tuple of str
        Columns of a table to read.
    time_columns : tuple of str
        Columns of a table's time, or of its date and time of day, if it is not the first that looks like one.
    start : str or datetime, optional
        Moment of 0 of a table's times that count, such as ``2026-12-11T12:00``.
    date : str or date, optional
        Day of the first row of a table whose times have no date, such as ``2026-12-11``.
    keep : "first" or "last", optional
        Which rows of a table to keep of times that come twice, because its clock stepped back.
    measures : str or mapping
        What the column of a table in W/m2 measures, such as ``ghi``, if its name does not say it; of several
        by their names, such as ``{"sun": "ghi"}``.
    encoding : str
        Encoding of a table.
    sheet : str
        Sheet of a workbook, where several have a table.

    Examples
    --------
    >>> tokyo = fieldkit.Site(35.68, 139.77, 25.0, "Asia/Tokyo")
    >>> options = fieldkit.ImportOptions(site=tokyo, zone="Asia/Tokyo", time_format="%Y%m%dT%H%M%S")
    >>> options.zone, options.offset_s
    ('Asia/Tokyo', None)
    """

    name: str | None = None
    title: str = ""
    site: Site | None = None
    kelvin_per_count: float | None = None
    kelvin_at_zero: float = 0.0
    times: Path | None = None
    time_format: str | None = None
    zone: str | None = None
    offset_s: float | Literal["auto"] | None = None
    unit: str = ""
    columns: tuple[str, ...] = ()
    time_columns: tuple[str, ...] = ()
    start: str | datetime | None = None
    date: str | date | None = None
    keep: Keep | None = None
    measures: str | Mapping[str, str] = ""
    encoding: str = "utf-8-sig"
    sheet: str = ""

    def __post_init__(self) -> None:
        scale = 1.0 if self.kelvin_per_count is None else self.kelvin_per_count
        offset_s = 0.0 if self.offset_s in (None, AUTO) else self.offset_s
        components = set(self.measures.values() if isinstance(self.measures, Mapping) else [self.measures])
        for is_wrong, field, example, others in (
            (self.name and not is_stream_name(self.name), "name", "logger2", ""),
            (self.zone and known_zone(self.zone) is None, "zone", "Asia/Tokyo", ", or UTC"),
            (scale <= 0.0 or math.isinf(scale), "kelvin_per_count", 0.01, "; NaN (none) if not known"),
            (not math.isfinite(self.kelvin_at_zero), "kelvin_at_zero", 273.15, ""),
            (not math.isfinite(offset_s), "offset_s", 83, ", or auto"),
            (not components <= {"", *COMPONENTS}, "measures", "ghi", f", of {', '.join(COMPONENTS)}"),
        ):
            if is_wrong:
                place, fix = Argument(field), Argument(field, example) + others
                raise ConfigError(f"{getattr(self, field)!r} is not valid", place=place, fix=fix)


@dataclass(frozen=True)
class ImportedSession:
    """A session made from another program's recording; `samples` counts those of each stream.

    `notes` describe how the recording was read: those of `Severity.WARNING` may change results.
    """

    path: Path
    samples: dict[str, int]
    size_bytes: int
    notes: tuple[tuple[Severity, str], ...]

    def open(self) -> Session:
        """The session, open for reading."""
        return open_session(self.path)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {name}" for name, count in self.samples.items())
        warnings = "".join(f"; {text}" for severity, text in self.notes if severity is not Severity.INFO)
        return f"<ImportedSession {self.path}: {counts}{warnings}>"

    @classmethod
    def of(cls, report: SealReport, recording: ImportedRecording) -> ImportedSession:
        """Notes on a sealed session and the recording it was made from."""
        return cls(report.path, report.counts, report.bytes, recording.notes)


def import_recording(
    source: str | Path,
    out: str | Path | None = None,
    options: ImportOptions | None = None,
    *,
    campaign: str | Path = ".",
    command_line: str = "",
    notify: Callable[[str], None] = log_warning,
) -> ImportedSession:
    """Make a session of a recording of another program, with the campaign's regions.

    Parameters
    ----------
    source : path
        A file, or a folder of frames; what it is follows from its content.
    out : path, optional
        The session's file; by default in ``recordings/`` of the campaign.
    options : ImportOptions, optional
        What the recording does not state itself.
    campaign : path
        Folder of the campaign, or one inside it; without a campaign the session has no regions.
    command_line : str
        Command that made the session, to be kept in it.
    notify : callable
        Receives a warning if the campaign cannot be used.

    Raises
    ------
    ConfigError
        If the source cannot be read, or place, times or scale are not known.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("log.csv").write_text('''time,light [lx]
    ... 2026-05-12 12:00:00,50000
    ... 2026-05-12 12:01:00,51000
    ... ''')
    >>> options = fieldkit.ImportOptions(site=fieldkit.Site(47.1, 8.5, 400.0, "Europe/Zurich"), zone="UTC")
    >>> made = fieldkit.import_recording("log.csv", "log.h5", options)
    >>> with made.open() as imported:
    ...     imported["logger"].readings().values.ravel().tolist()
    [50000.0, 51000.0]
    """
    source, options = Path(source), options or ImportOptions()
    if options.offset_s == AUTO:
        raise ConfigError("auto needs the session to align with", place=_OFFSET, fix=Action.IMPORT_INTO())
    config = _campaign_or_none(Path(campaign), notify)
    try:
        recording = _read_in_zone(source, options, config.site if config else None, "campaign")
    except MissingOptionsError as error:
        raise imported.together(error, *(() if options.site or config else (_NO_SITE,))) from None
    site, recording = _with_site(recording, options.site, config)
    recording = imported.possible(recording, config.limits if config else changed_rows({}, site.body), site)
    title, regions = options.title or source.name, config.regions if config else ()
    header = SessionHeader(title, site, recording.streams, regions, command_line=command_line)
    path = Path(out) if out is not None else _default_path(config, recording, source)
    path.parent.mkdir(parents=True, exist_ok=True)
    return ImportedSession.of(imported.write_imported(path, header, recording, str(source)), recording)


def import_into(
    session: SessionOrFile,
    source: str | Path,
    out: str | Path | None = None,
    options: ImportOptions | None = None,
) -> ImportedSession:
    """Make a new session of `session` together with the part of `source` recorded at the same time.

    `out` is the new session's file, by default beside the old one. Raises `ConfigError` if the source
    cannot be read or does not fit, `NoAnswerError` if ``offset_s="auto"`` finds no offset.

    Examples
    --------
    >>> light = session["lux"].to_pandas()[["illuminance [lx]"]]
    >>> light.to_csv("logger.csv", date_format="%Y-%m-%d %H:%M:%S")
    >>> made = fieldkit.import_into(session, "logger.csv", "both.h5", fieldkit.ImportOptions(zone="UTC"))
    >>> with made.open() as both:
    ...     list(both.streams)
    ['camera', 'lux', 'thermometer', 'logger']
    """
    source, options = Path(source), options or ImportOptions()
    _refuse_unused(source, options, {"title", "site"}, "merged into a session, which keeps site and title")
    if merged.is_session(source):
        return _join(session, source, out, options)
    with reading(session) as opened:
        recording = _read_in_zone(source, options, opened.site, "session")
        stream_name = options.name or recording.streams[0].name
        path = Path(out or opened.path.with_name(f"{opened.path.stem}-with-{stream_name}.h5"))
        if options.offset_s == AUTO:
            recording = align(opened, recording)
        recording = cut_session(opened, _warned_of_distance(recording, opened.site))
        recording = imported.possible(recording, _limits_of(opened), opened.site)
        recording = _warned_of_irradiance(opened, recording)
        return ImportedSession.of(merge(opened, recording, path, str(source)), recording)


def _join(
    session: SessionOrFile, source: Path, out: str | Path | None, options: ImportOptions
) -> ImportedSession:
    """Both sessions as a new one, `source` on the clock of `session`."""
    unused = {field.name for field in fields(options)} - {"name", "offset_s"}
    _refuse_unused(source, options, unused, "a session")
    with reading(session) as opened, reading(source) as other:
        merged.require_joinable(opened, other)
        if options.offset_s is None or options.offset_s == AUTO:
            clock = merged.clock_difference(opened, other)
        else:
            clock = Alignment(options.offset_s, math.nan, math.nan, "as stated")
        recording = merged.recording_of(opened, other, clock, options.name)
        if keys := configured_otherwise(opened, other):
            text = f"slopes use the settings of {opened.path.name}, not {', '.join(keys)} of {source.name}"
            recording = recording.noted(text)
        recording = _warned_of_irradiance(opened, recording)
        path = Path(out or opened.path.with_name(f"{opened.path.stem}-with-{source.stem}.h5"))
        return ImportedSession.of(merged.join(opened, other, recording, clock, path), recording)


def _limits_of(session: SessionReader) -> dict[str, tuple[float, float]]:
    """The rows of the table of limits that differ in a session: its body's, and those of its streams."""
    rows = changed_rows({}, session.site.body)
    for info in session.streams.values():
        rows |= info.limits
    return rows


def _campaign_or_none(start: Path, notify: Callable[[str], None]) -> Config | None:
    """The configuration of the campaign around a folder; None without one, or if it has mistakes."""
    try:
        return load_config(find_campaign(start))
    except NoCampaignError:
        return None
    except FieldkitError as error:
        notify(f"the campaign is ignored: {error.message}")
        return None


def _with_site(
    recording: ImportedRecording, site: Site | None, config: Config | None
) -> tuple[Site, ImportedRecording]:
    """Site of the recording, and the recording with a warning if only the campaign states that."""
    if site is not None and recording.site is not None and apart_m(site, recording.site) >= SAME_PLACE_M:
        problem = f"{_coordinates(site)}, but the recording states {_coordinates(recording.site)}"
        raise ConfigError(problem, place=Argument("site"), fix="omit that option")
    if place := site or recording.site:
        return place, recording
    if config is None:
        raise _NO_SITE
    default = PAPER_SITE["latitude_deg"], PAPER_SITE["longitude_deg"]
    is_default = (config.site.latitude_deg, config.site.longitude_deg) == default
    note = " (the paper's, the default of a campaign)" if is_default else ""
    text = f"no site was given: taken as recorded at the campaign's site, {_coordinates(config.site)}{note}; "
    text += "if it was elsewhere, import it again with its site"
    return config.site, recording.noted(text)


def _coordinates(site: Site) -> str:
    return f"{site.latitude_deg:g}, {site.longitude_deg:g}"


def _warned_of_distance(recording: ImportedRecording, site: Site) -> ImportedRecording:
    """The recording, with a warning if it was made at another place than the session."""
    away_m = apart_m(recording.site, site) if recording.site else 0.0
    if away_m < SAME_PLACE_M:
        return recording
    text = f"the station is {away_m / 1000.0:.0f} km from the session's site: cloud cover may differ"
    return recording.noted(text)


def _warned_of_irradiance(session: SessionReader, recording: ImportedRecording) -> ImportedRecording:
    """The recording, with a warning if estimates will use its irradiance instead of the session's."""
    own = tuple(session.streams.values())
    settings = EstimatorSettings()
    before, after = (sunlight_source(streams, settings) for streams in (own, own + recording.streams))
    if before is None or after is None or before.info.name == after.info.name:
        return recording
    which = f"{after.info.name} ({after.measures}), not of {before.info.name}"
    keeps = f'irradiance.stream = "{before.info.name}" keeps it'
    return recording.noted(f"slopes now use the irradiance of {which}; {keeps}")


def _default_path(config: Config | None, recording: ImportedRecording, source: Path) -> Path:
    """A session's file in the campaign's recordings, named by its first sample's time and its source."""
    first = next(iter(recording.samples))
    stamp = datetime.fromtimestamp(first.time_ns // 10**9, UTC).strftime("%Y%m%dT%H%M%SZ")
    word = source.name.split(".")[0]
    name = f"{stamp}-{''.join(c if c.isalnum() or c in '-_' else '-' for c in word)}.h5"
    return (config.recordings if config else Path()) / name


def read_source(source: Path, options: ImportOptions) -> ImportedRecording:
    """Read a source by the first format that fits it.

    Raises `ConfigError` if none does, or if an option is given that the format does not use.
    """
    if not source.is_file() and not source.is_dir():  # a pipe or a device may never end
        raise ConfigError("neither a file nor a folder", place=source, fix="check the path of the file")
    refuse_unread(source)
    for source_format in _FORMATS:
        if source_format.fits(source):
            unused = {field.name for field in fields(options)} - _OF_ALL - source_format.uses
            _refuse_unused(source, options, unused, source_format.name)
            recording = source_format.read(source, **_facts(options, source_format.uses))
            if not recording.streams:
                raise ConfigError("no column of numbers", place=source, fix="check what it holds")
            zone = options.zone or source_format.zone
            return recording.noted(f"times in {zone}", Severity.INFO) if source_format.zone else recording
    fix = (
        "import one of .raw.y16.gz, .fff, .seq, .csq, radiometric .jpg, TIFF, 16-bit PNG, .irg, CSV frames, "
        "tables and workbooks, netCDF, bags of ROS, files of radiation networks and services"
    )
    raise ConfigError("no format that fieldkit reads", place=source, fix=fix)


def _read_in_zone(source: Path, options: ImportOptions, site: Site | None, whose: str) -> ImportedRecording:
    """The recording, its times in the zone of a site where neither source nor options say anything of one."""
    try:
        return read_source(source, options)
    except UnstatedZoneError:
        # by a longitude the zone is whole hours without summer time, and a session's may be UTC by default
        if site is None or site.timezone.startswith("Etc/") or (site.timezone, whose) == ("UTC", "session"):
            raise
        recording = read_source(source, replace(options, zone=site.timezone))
        text = f"no zone is stated: its times were taken in that of the {whose}, {site.timezone}"
        return recording.noted(text)


def _refuse_unused(source: Path, options: ImportOptions, unused: AbstractSet[str], name: str) -> None:
    """Refuse options other than their defaults that would have no effect."""
    used_options = [field.name for field in fields(options) if getattr(options, field.name) != field.default]
    if without_effect := [Argument(field) for field in used_options if field in unused]:
        names = Sentence.listing(without_effect)
        raise ConfigError(f"is {name}: " + names + " would have no effect", place=source, fix="omit " + names)


def _refuse_session(source: Path, **facts: Any) -> ImportedRecording:
    raise ConfigError("is a session already", place=source, fix="join it: " + Action.IMPORT_INTO(source))


def _is_flir(source: Path) -> bool:
    """A FLIR file, or a folder of them; JPEGs beside other frames are only to look at."""
    if source.is_dir():
        beside = {path.suffix.lower() for path in stills.image_files(source)}
        return bool(import_flir.files_in(source)) and beside <= {".png"}
    return source.suffix.lower() in import_flir.SUFFIXES


def _is_stills(source: Path) -> bool:
    return source.is_dir() or source.suffix.lower() in stills.SUFFIXES or is_frame_table(source)


def _is_jma(source: Path) -> bool:
    return jma.is_radiation_table(source) or jma.is_obsdl(source)


def _jma(source: Path, name: str = "station", date: date | str | None = None) -> ImportedRecording:
    is_radiation = jma.is_radiation_table(source)
    if date is not None and not is_radiation and jma.is_of_one_day(source):
        of_day = LogOptions(zone=jma.JST, date=f"{date}", encoding=jma.encoding_of(source))
        return read_log(source, name, of_day)
    _refuse_unused(source, ImportOptions(date=date), {"date"}, "a file with dates")
    return (jma.read_radiation_table if is_radiation else jma.read_obsdl)(source, name)


def _is_table(source: Path) -> bool:
    return Path(source.name.lower().removesuffix(".gz")).suffix in TABLES


def _table(source: Path, name: str = "logger", **facts: Any) -> ImportedRecording:
    return read_log(source, name, LogOptions(**facts))


def _facts(options: ImportOptions, uses: AbstractSet[str]) -> dict[str, Any]:
    """The options that a format uses, as its reader takes them: nanoseconds, a scale, a zone with its rules.

    Raises `ConfigError` for an offset of frames that is to be found from a session's streams.
    """
    facts = attributes(options, *(uses - _CONVERTED)) | ({"name": options.name} if options.name else {})
    if "zone" in uses and options.zone:
        facts["zone"] = ZoneInfo(options.zone)
    if "offset_s" in uses and options.offset_s:
        if options.offset_s != AUTO:
            facts["offset_ns"] = round(options.offset_s * 1e9)
        elif not uses >= _TABLE:
            raise ConfigError("auto aligns readings, not frames", place=_OFFSET, fix=Argument("offset_s", 83))
    if "kelvin_per_count" in uses:
        facts["scale"] = _scale(options)
    return facts


def _scale(options: ImportOptions) -> stills.Scale | None:
    if options.kelvin_per_count is not None:
        return stills.Scale(options.kelvin_per_count, options.kelvin_at_zero)
    if options.kelvin_at_zero:
        place, fix = Argument("kelvin_at_zero"), "add " + Argument("kelvin_per_count")
        raise ConfigError("has no effect alone", place=place, fix=fix)
    return None


class _Format(NamedTuple):
    """A format: what a file of it is called, how it is recognised and read, the options that its reader uses.

    `zone` is that of its times, where no note of the reader has it.
    All other fields of `ImportOptions` are refused, so a reader sees nothing but what it declares.
    """

    name: str
    fits: Callable[[Path], bool]
    read: Callable[..., ImportedRecording]
    uses: frozenset[str] = frozenset()
    zone: str = ""


_OF_ALL = {"name", "title", "site"}
_CONVERTED = {"zone", "offset_s", "kelvin_per_count", "kelvin_at_zero"}
_TIMES = frozenset({"times", "time_format", "zone", "offset_s"})
_FRAMES = _TIMES | {"kelvin_per_count", "kelvin_at_zero", "unit"}
_TABLE = _TIMES - {"times"} | {"unit", "columns", "keep", "measures", "time_columns", "start", "date"}
_BAG = frozenset({"kelvin_per_count", "kelvin_at_zero", "unit", "columns", "offset_s"})
_FORMATS = (
    _Format("a session", merged.is_session, _refuse_session, frozenset({"offset_s"})),
    _Format("a FLIR recording", _is_flir, import_flir.read_flir, _TIMES, "UTC"),
    _Format("a recording of ROS", is_bag, read_bag, _BAG, "UTC"),
    _Format("a recording of TIFF, PNG, IRG or CSV frames", _is_stills, stills.read_stills, _FRAMES, "UTC"),
    _Format("a station's file", is_station_file, read_station, zone="UTC"),
    _Format("a file of the Japan Meteorological Agency", _is_jma, _jma, frozenset({"date"})),
    _Format("a PureThermal recording", is_purethermal, read_purethermal, frozenset({"offset_s"}), "UTC"),
    _Format("a workbook, or a table of a program", is_container, _table, _TABLE | {"sheet"}),
    # last: other formats have the same suffixes
    _Format("a table", _is_table, _table, _TABLE | {"encoding"}),
)
