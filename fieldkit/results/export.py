"""A session as files for other programs: tables, netCDF, MCAP, images, film."""

from __future__ import annotations

import contextlib
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, overload

from fieldkit.config import find_campaign
from fieldkit.config.edit import editing, set_key
from fieldkit.model.errors import ConfigError, IncompleteError, StorageError, os_errors_as
from fieldkit.model.mark_times import moment_of, parse_when
from fieldkit.model.next_step import Argument
from fieldkit.model.spelling import did_you_mean
from fieldkit.model.text_file import parse_toml, read_text
from fieldkit.results.batch import BySession, each
from fieldkit.results.result_files import campaign_folder
from fieldkit.results.sources import ONE, SessionOrFile, path_of, reading
from fieldkit.sessions.formats.exports import EXPORTS, ExportFormat
from fieldkit.sessions.reader import SessionReader
from fieldkit.views import formatting


@dataclass(frozen=True)
class Export:
    """Files written from a session into `folder`, and `problems` with samples that are missing or damaged."""

    folder: Path
    files: tuple[Path, ...]
    problems: tuple[str, ...]


@overload
def export(session: SessionOrFile, to: str, folder: str | Path | None = None, **options: Any) -> Export: ...
@overload
def export(
    session: Sequence[SessionOrFile], to: str, folder: str | Path | None = None, **options: Any
) -> BySession[Export]: ...
def export(  # type: ignore[misc]  # the options above are those below
    session: SessionOrFile | Sequence[SessionOrFile],
    to: str,
    folder: str | Path | None = None,
    *,
    stream: str | None = None,
    every: int = 1,
    begin: str | None = None,
    until: str | None = None,
    speed: float | None = None,
    palette: str | None = None,
    license: str | None = None,
    executor: Executor | None = None,
    on_frame: Callable[[], None] | None = None,
) -> Export | BySession[Export]:
    """Write a session, or each of several, for other programs.

    Parameters
    ----------
    session : Session or path
        The session to export, or its file, or several; their exports are returned by file.
    to : str
        A format by its name in `fieldkit.sessions.formats.exports.EXPORTS`, such as ``"csv"``.
    folder : path, optional
        Where to write, of several sessions each into ``NAME`` there; by default ``results/NAME`` of the
        campaign, or a folder beside the session.
    stream : str, optional
        Which camera, if there are several; for MCAP, the only stream to write.
    every : int
        Write only every n-th frame.
    begin, until : str, optional
        Only frames from then on, and up to then: ``"12:31"`` at the site, ``"-5m"`` before the session's end,
        or ISO 8601.
    speed : float, optional
        Of a video: seconds of the session per second; by default each frame is one of 25 pictures a second.
    palette : str, optional
        Colours of images and videos, of `fieldkit.palettes.NAMES`; inferno by default.
    license : str, optional
        Of an RO-Crate, by default the campaign's: an SPDX identifier such as ``"CC-BY-4.0"``, or an address.
        It is written to ``fieldkit.toml``.
    executor : Executor, optional
        Any of `concurrent.futures`, whose workers write those of several; this process unless given.
    on_frame : callable, optional
        Called at each frame of the session, for progress; not in other processes.

    Raises
    ------
    ConfigError
        If there is no such kind, it does not take an option that is given, or a time cannot be read.
    StorageError
        If the files cannot be written.

    Examples
    --------
    >>> exported = fieldkit.export(session, "csv")
    >>> [path.name for path in exported.files][:2]
    ['20160101T190001Z-noon-camera-regions.csv', '20160101T190001Z-noon-lux.csv']
    """
    if to not in EXPORTS:
        raise ConfigError("not a kind of export", place=Argument("to", to), fix=did_you_mean(to, EXPORTS))
    chosen = EXPORTS[to]
    options: dict[str, Any] = {"stream": stream, "every": every, "speed": speed, "palette": palette}
    options["license"] = license
    times: dict[str, Any] = {"begin": begin, "until": until}
    _refuse_unused(to, {**options, **times})
    if not isinstance(session, ONE):
        write = export if folder is None else _export_into
        return each(write, session, executor, to, folder, **options, **times)
    target = Path(folder) if folder is not None else _default_folder(path_of(session))
    with reading(session) as opened:
        options["on_frame"] = on_frame
        if "license" in chosen.takes:
            options |= _deposit(opened, license)
        options["between_ns"] = None if begin is until is None else _between_ns(opened, begin, until)
        used = {name: value for name, value in options.items() if value is not None and name in chosen.takes}
        fix = "name a folder that can be written and has room"
        with os_errors_as(StorageError, "cannot write", place=target, fix=fix):
            target.mkdir(parents=True, exist_ok=True)
            files, problems = _write(opened, target, chosen, used)
        return Export(target, tuple(files), (*problems, *_damage(opened, chosen)))


def campaign_facts(session: SessionReader) -> dict[str, str]:
    """Licence and ORCID by the campaign around a session as it is now, else as recorded; empty if unknown."""
    tables = [tomllib.loads(session.config_toml)]
    with contextlib.suppress(ConfigError):
        file = find_campaign(session.path.resolve().parent)
        tables.insert(0, parse_toml(read_text(file), file))
    facts = [*(table.get("campaign", {}) for table in tables), {"license": session.header.license}]
    return {key: next(filter(None, (fact.get(key) for fact in facts)), "") for key in ("license", "orcid")}


def _deposit(session: SessionReader, license: str | None) -> dict[str, str]:
    """Licence and ORCID of a deposit; a licence that is given is written to the campaign's file."""
    facts = campaign_facts(session)
    if license is None and not facts["license"]:
        fix = "give it once: " + Argument("license", "CC-BY-4.0")
        raise ConfigError("an archive needs the licence of the data", place=session.path, fix=fix)
    if license is not None and license != facts["license"]:
        with contextlib.suppress(ConfigError), editing(find_campaign(session.path.resolve().parent)) as draft:
            set_key(draft, "campaign", "license", license)
    return facts if license is None else {**facts, "license": license}


def _export_into(session: Path, to: str, folder: Path, **options: Any) -> Export:
    return export(session, to, Path(folder) / session.stem, **options)


def _default_folder(session: Path) -> Path:
    results = campaign_folder(session, "results")
    return results / session.stem if results else session.resolve().parent / f"{session.stem}-export"


def _refuse_unused(to: str, options: Mapping[str, object]) -> None:
    """Raise `ConfigError` for an option that is stated and the format does not take."""
    for option, value in options.items():
        name = "between_ns" if option in ("begin", "until") else option
        if value not in (None, 1) and name not in EXPORTS[to].takes:
            those = ", ".join(kind for kind, export_format in EXPORTS.items() if name in export_format.takes)
            fix = "omit " + Argument(option) + f", which is for {those}"
            raise ConfigError(f"{to} does not take it", place=Argument(option, value), fix=fix)


def _between_ns(session: SessionReader, begin: str | None, until: str | None) -> tuple[float, float]:
    """Two times as people write them, in UTC nanoseconds; `ConfigError` for one outside."""
    first, last = (formatting.local_time(ns, session.site) for ns in (session.start_ns, session.end_ns))
    start = first if begin is None else _moment(begin, first, last)
    end = last if until is None else _moment(until, first, last)
    if begin and until and start > end:
        fix = "give it as " + Argument("begin")
        raise ConfigError("lies before the start", place=Argument("until", until), fix=fix)
    if start > last or end < first:
        problem = f"no sample lies then: it lasts from {first:%Y-%m-%d %X} to {last:%Y-%m-%d %X}"
        raise ConfigError(problem, place=session.path, fix="give times of the session")
    return (
        -math.inf if begin is None else round(start.timestamp() * 1e6) * 1000,
        math.inf if until is None else round(end.timestamp() * 1e6) * 1000,
    )


def _moment(text: str, first: datetime, last: datetime) -> datetime:
    """The moment of a time as people write it; 12:31 is that of the session, or the one nearest to it."""
    same_day, next_day = (moment_of(parse_when(text, end), end) for end in (last, last + timedelta(days=1)))
    is_clock_time = ":" in text[:3]
    return next_day if is_clock_time and first - same_day > next_day - last else same_day


def _write(
    session: SessionReader, folder: Path, chosen: ExportFormat, options: Mapping[str, object]
) -> tuple[list[Path], list[str]]:
    """The files, and what could not be read for them."""
    try:
        return chosen.write(session, folder, options), []
    except IncompleteError as error:
        return list(error.files), [error.message]


def _damage(session: SessionReader, chosen: ExportFormat) -> list[str]:
    """Damage that the export found: samples that do not match their checksum."""
    fate = "they are omitted" if chosen.omits_damaged else "they are flagged bad_crc"
    return [
        f"{count} of {session.count(name)} samples of {name} do not match their checksum, {fate}"
        for name, count in session.damaged.items()
    ]
