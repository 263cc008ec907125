"""Times as other programs write them, to UTC nanoseconds; a missing zone is never guessed."""

from __future__ import annotations

import csv
import itertools
import re
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta, tzinfo
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from fieldkit.model import clock
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument, Sentence, Text
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.formats.imported import MissingOptionsError, UnstatedZoneError, explained

_COARSE_S = 1800.0
"""Rows so far apart cannot go back within an hour that comes twice."""

_WORDS = {"yyyy": "%Y", "mm": "%m", "dd": "%d", "HH": "%H", "MM": "%M", "SS": "%S"}
_END_OF_DAY = re.compile(r"(?<![\d:])24:00(?=(:00(\.0*)?)?(?![\d:.]))")
_LEAP_SECOND = re.compile(r"(?<=:59):60(?!\d)")

# dates whose year comes first have one order only; of others it must be given
_YEAR_FIRST = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})(?=$|[T ])(?:[T ]+(\d{1,2}:.+))?")
_DATED = re.compile(
    r"(\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}|(19|20)\d\d[01]\d[0-3]\d"
    r"|20\d\d[01]\d[0-3]\d(\d\d){1,3})(?=$|[T ])"
)
_DATE_DIGITS = 8  # 20260512
_WIDTHS = {"Y": 4, "j": 3}  # other numbers of strptime have two digits
_UNIX = re.compile(r"\d{9,11}([.,]\d+)?|\d{13}(\d{3}){0,2}")
_CLOCK = re.compile(r"\d{1,3}:\d{2}(:\d{2}([.,:]\d+)?)?(\s*[AP]\.?\s?(M\.?)?)?", re.IGNORECASE)
# also Davis's 10:00a, Spanish p. m.
_HALF_DAY = re.compile(r"(?<=\d)\s*([ap])\.?\s?(?:m\.?)?$", re.IGNORECASE)
_MILLISECONDS = re.compile(r"(?<=:\d\d:\d\d):(?=\d{3}$)")  # phones, Keysight
_SECOND_MARK = re.compile(r"(?<=:\d\d)'(?=\d\d$)")  # T&D: 12:00'30
_SPACED_OFFSET = re.compile(r" ?([+-]\d\d:?\d\d)( UTC| GMT)?$")
_NUMBER = re.compile(r"[+-]?\d*([.,]\d*)?(e[+-]?\d+)?", re.IGNORECASE)
_ELAPSED = re.compile(r"(\d+):(\d\d):(\d\d(?:[.,]\d+)?)")


GIVE_ZONE = Argument("zone", "Asia/Tokyo") + ", or UTC"


class Times(NamedTuple):
    """UTC nanoseconds by row, the errors of rows without any, and whether a time needed the zone."""

    known_ns: dict[int, int]
    unreadable: dict[int, ConfigError]
    needed_zone: bool


def parse_times_ns(texts: Sequence[str], zone: tzinfo | None, time_format: str | None = None) -> list[int]:
    """UTC nanoseconds of times as `read_times` reads them; raises `ConfigError` where one is unreadable."""
    times = read_times(texts, zone, time_format)
    for error in times.unreadable.values():
        raise error
    return [times.known_ns[row] for row in range(len(texts))]


def read_times(texts: Sequence[str], zone: tzinfo | None, time_format: str | None = None) -> Times:
    """The times of a log in the order of its rows.

    They are ISO 8601, also with slashes or points in a date whose year comes first, Unix seconds (or ms, µs,
    ns by their number of digits), or as `time_format` describes: for strptime (``%Y-%m-%d``) or in plain
    letters (``yyyy/mm/dd HH:MM:SS``). 24:00 is midnight of the next day, a leap second 23:59:60 the second
    before. Of the hour that comes twice at the end of summer time, the rows up to where the clock goes back
    belong to the first.

    Raises `ConfigError` where strptime would read the format wrongly, a time has no offset and no `zone` is
    given, names an hour that was skipped, or one that came twice and the order of the rows leaves open which.
    """
    if time_format is not None:
        _pattern(time_format)  # a wrong format is no matter of any one time
    known_ns: dict[int, int] = {}
    written: dict[int, datetime] = {}
    unreadable: dict[int, ConfigError] = {}
    for row, text in enumerate(texts):
        try:
            if time_format is None and is_unix(text):
                known_ns[row] = _unix_ns(text)
            else:
                written[row] = _parse(text, time_format)
        except ConfigError as error:
            unreadable[row] = error if unreadable else _give_format(text, texts, time_format)
    for row, moment in _in_zone(texts, written, zone).items():
        try:
            known_ns[row] = utc_ns(moment)
        except ConfigError as error:
            unreadable[row] = error
    return Times(known_ns, unreadable, any(moment.tzinfo is None for moment in written.values()))


def _in_zone(
    texts: Sequence[str], written: Mapping[int, datetime], zone: tzinfo | None
) -> dict[int, datetime]:
    """The times with their offset, of an hour that came twice the one by the order of the rows."""
    moments: dict[int, datetime] = {}
    for row, moment in written.items():
        if moment.tzinfo is None and zone is None:
            raise UnstatedZoneError("a time without a zone", place=repr(texts[row]), fix=GIVE_ZONE)
        moments[row] = moment = moment if moment.tzinfo else moment.replace(tzinfo=zone)
        if _hours_back(moment) < 0:
            problem = f"does not exist in {moment.tzinfo}: clocks were put forward over it"
            raise ConfigError(problem, place=repr(texts[row]), fix=_fixed_offset(moment))
    for row in _second_times(moments, texts):
        moments[row] = moments[row].replace(fold=1)
    return moments


def _unix_ns(text: str) -> int:
    seconds, _, fraction = text.replace(",", ".").partition(".")
    if len(seconds) > 11:
        return plausible_ns(int(seconds.ljust(19, "0")))
    return plausible_ns(int(seconds) * 10**9 + int(fraction[:9].ljust(9, "0")))


def _hours_back(moment: datetime) -> float:
    """Hours by which clocks were put back over this time: above 0 it came twice, below 0 never."""
    before, behind = _offsets_h(moment)
    return before - behind


def _offsets_h(moment: datetime) -> list[float]:
    """Hours ahead of UTC of a time, and of the second of two."""
    offsets = (moment.replace(fold=fold).utcoffset() or timedelta() for fold in (0, 1))
    return [offset / timedelta(hours=1) for offset in offsets]


def _second_times(moments: Mapping[int, datetime], texts: Sequence[str]) -> Iterator[int]:
    """Rows whose time came twice and which belong to the second, by the order of the rows.

    The clock goes back once in such a run of rows, which may stand newest first.
    """
    local = {row: moment.replace(tzinfo=None) for row, moment in moments.items()}
    changes_s = [(later - earlier).total_seconds() for earlier, later in itertools.pairwise(local.values())]
    newest_first = sum(change < 0.0 for change in changes_s) > len(changes_s) / 2
    is_coarse = bool(changes_s) and statistics.median(map(abs, changes_s)) >= _COARSE_S
    order = sorted(moments, reverse=newest_first)
    for is_twice, run in itertools.groupby(order, key=lambda row: _hours_back(moments[row]) > 0):
        rows = list(run)
        if not is_twice:
            continue
        pairs = list(enumerate(itertools.pairwise(local[row] for row in rows), start=1))
        back = [place for place, (earlier, later) in pairs if later < earlier]
        if not back and is_coarse:  # an hourly log only repeats itself
            back = [place for place, (earlier, later) in pairs if later == earlier]
        if len(back) != 1:
            moment = moments[rows[0]]
            problem = f"came twice in {moment.tzinfo}, at the end of summer time, "
            problem += "and the order of the rows leaves open which it was"
            raise ConfigError(problem, place=repr(texts[rows[0]]), fix=_fixed_offset(moment))
        yield from rows[back[0] :]


def _fixed_offset(moment: datetime) -> Text:
    """Next step where a clock's zone leaves its times open: name the offset that it kept."""
    zones = " or ".join(f"Etc/GMT{-int(hour):+d}" for hour in sorted(_offsets_h(moment)) if hour.is_integer())
    cut = "export it with times in UTC, or import what lies before and after on its own"
    return "if its clock was never set: " + Argument("zone") + f" {zones}; else {cut}" if zones else cut


def utc_ns(moment: datetime) -> int:
    """UTC nanoseconds since 1970 of a moment with a zone, exact to the microsecond; raises `ConfigError`."""
    try:
        time_ns = clock.utc_ns(moment)
    except ValueError as error:
        raise ConfigError(str(error), place=moment.isoformat(), fix="check its clock and format") from None
    return plausible_ns(time_ns)


def plausible_ns(time_ns: int) -> int:
    """The same; raises `ConfigError` before 1970, and after 2262, where 64 bits end."""
    if not 0 <= time_ns < 2**63:
        problem = f"a time {time_ns / 1e9:.0f} s after 1970 is none of a recording"
        raise ConfigError(problem, fix="check its clock and format")
    return time_ns


def _parse(text: str, time_format: str | None) -> datetime:
    plain, midnights = _END_OF_DAY.subn("00:00", text)
    plain = _MILLISECONDS.sub(".", _LEAP_SECOND.sub(":59", _SECOND_MARK.sub(":", plain)))
    if ":" in plain:
        plain = _HALF_DAY.sub(lambda half: f"{half[1].upper()}M", plain)
    pattern = None if time_format is None else _pattern(time_format)
    try:
        moment = _iso(plain) if pattern is None else _by_pattern(plain, pattern)
        return moment + timedelta(days=midnights)
    except (ValueError, OverflowError) as error:
        expected = time_format or "ISO 8601, such as 2026-12-11T12:00:00+09:00"
        raise ConfigError(f"not a time as expected: {expected}", place=repr(text)) from error


_DATES = re.split(
    "[|]",
    "%d.%m.%Y|%d.%m.%y|%m/%d/%Y|%d/%m/%Y|%m/%d/%y|%d/%m/%y|%m-%d-%Y|%d-%m-%Y|%d.%m.%Y,|%m/%d/%Y,|%d/%m/%Y,|%d-%b-%Y"
    "|%d-%b-%y|%d %b %Y|%d/%b/%Y|%b %d %Y|%b %d, %Y|%Y-%m-%d|%Y/%m/%d|%Y.%m.%d|%Y%m%d|%Y-%j|%Y年%m月%d日",
)
_CLOCKS = re.split(
    "[|]",
    "%H:%M|%H:%M:%S|%H:%M:%S.%f|%H:%M:%S,%f|%I:%M:%S %p|%I:%M %p|%H%M|%H.%M|%H.%M.%S"
    "|%H時%M分|%H時%M分%S秒|%Hh%M",
)
_DIGITS = ["%Y%m%d%H", "%Y%m%d%H%M", "%Y%m%d%H%M%S"]


def _give_format(text: str, others: Sequence[str], time_format: str | None) -> ConfigError:
    """The error of a time in another form, with the usual formats that fit it and most of the others."""
    clocks = [f"{date}{mark}{clock}" for date in _DATES for mark in " T" for clock in _CLOCKS]
    fitting = [time_format for time_format in [*_DATES, *_DIGITS, *clocks] if is_time(text, time_format)]
    sample = others[:: 1 + len(others) // 50]
    counts = [sum(is_time(other, time_format) for other in sample) for time_format in fitting]
    best = [time_format for time_format, count in zip(fitting, counts, strict=True) if count == max(counts)]
    formats = [Argument("time_format", time_format) for time_format in best[:2]]
    # none is of months in other languages, or of eras
    digits = "write dates in digits, such as 2026-12-11 12:00:00"
    fix = "give the format of the times, such as " + Sentence.listing(formats) if formats else digits
    kind = ConfigError if time_format else MissingOptionsError
    return kind(f"not a time in {time_format or 'ISO 8601'}", place=repr(text), fix=fix)


def _iso(text: str) -> datetime:
    match = _YEAR_FIRST.fullmatch(text)
    if match is None:
        return datetime.fromisoformat(text)
    year, month, day, clock = match.groups(default="00:00")
    clock = _SPACED_OFFSET.sub(r"\1", re.sub(r"(?<=:\d\d) ?(UTC|GMT)$", "+00:00", clock))
    if clock.endswith("M"):
        half_day = "%I:%M:%S%p" if clock.count(":") > 1 else "%I:%M%p"
        clock = datetime.strptime(clock, half_day).time().isoformat()
    clock = clock if clock[2] == ":" else f"0{clock}"
    return datetime.fromisoformat(f"{year}-{month:0>2}-{day:0>2}T{clock}")


def _by_pattern(text: str, pattern: str) -> datetime:
    """A time by a strptime pattern; raises `ValueError`, also where too few digits stand side by side.

    There strptime takes one digit where two belong: 1530 as ``%H%M%S`` would be 15:03:00. Hours without their
    zero are meant: 130 as ``%H%M`` is 01:30.
    """
    parts = re.split("((?:%[A-Za-z])+)", pattern)
    literals = [re.escape(part).replace(r"\ ", r"\s+") for part in parts[::2]]
    match = re.fullmatch("(.+?)".join(literals), text, re.IGNORECASE)
    if match is None:  # strptime compiles each of hundreds of patterns to find out
        raise ValueError(f"{text} is not written as {pattern}")
    days = 0
    for place, (run, cell) in enumerate(zip(parts[1::2], match.groups(), strict=True)):
        width = sum(_WIDTHS.get(code, 2) for code in run[1::2])
        if len(run) > 2 and cell.isdigit() and len(cell) < width:
            if not run.startswith("%H") or (run != "%H%M" and len(cell) < width - 1):
                raise ValueError(f"{text} has too few digits for {run}")
            cell = cell.zfill(width)
        if run.startswith("%H%M") and cell.startswith("2400"):
            cell, days = f"00{cell[2:]}", 1
        parts[2 * place + 1] = cell
    return datetime.strptime("".join(parts), pattern) + timedelta(days=days)


@lru_cache
def _pattern(time_format: str) -> str:
    """A format as strptime has it, also of plain letters such as ``yyyy/mm/dd HH:MM:SS``.

    Raises `ConfigError` where strptime would read times wrongly without a word: AM and PM count with ``%I``
    alone, and the zone of ``%Z`` is dropped.
    """
    pattern = time_format
    if "%" not in time_format:
        pattern = re.sub("|".join(_WORDS), lambda found: _WORDS[found[0]], time_format)
    # times have these forms when they come here
    pattern = re.sub(r"\s+%p", "%p", pattern).replace("%S:%f", "%S.%f").replace("%M'%S", "%M:%S")
    codes = re.findall("%(.)", pattern)
    twice = next((code for code, count in Counter(codes).items() if count > 1 and code != "%"), None)
    if twice is not None:
        wrong, fix = f"has %{twice} twice", "%m is the month, %M the minute; %d the day, %H the hour"
    elif ("I" in codes) != ("p" in codes):
        wrong, fix = "has only one of %I and %p", "write %I with %p for hours up to 12, else %H"
    elif "Z" in codes:
        wrong, fix = "has %Z, which reads no zone", "write the letters for %Z and name the zone, or %z"
    else:
        return pattern
    raise ConfigError(wrong, place=Argument("time_format", time_format), fix=fix)


# --- what cells of a table look like before their order and zone are known


def is_dated(text: str) -> bool:
    """True if a text begins with a date in digits."""
    return _DATED.match(text) is not None


def is_time(text: str, time_format: str | None) -> bool:
    """True if a text is a time by a format, if there is one."""
    try:
        return time_format is not None and bool(_parse(text, time_format))
    except ConfigError:
        return False


def is_date_alone(text: str) -> bool:
    """True if a text that is a time or date has no time of day and counts no seconds."""
    return ":" not in text and sum(map(str.isdigit, text)) <= _DATE_DIGITS


def is_unix(text: str) -> bool:
    """True if a text may be seconds since 1970, or ms, µs, ns; 2026051215 is a date and an hour."""
    return _UNIX.fullmatch(text) is not None and not is_dated(text)


def is_clock(text: str) -> bool:
    """True if a text is a time of day: ``15:30``, ``15:30:46.5``, ``3:30 PM``."""
    return _CLOCK.fullmatch(text) is not None


def has_day(time_format: str | None) -> bool:
    """False if a format is of times of day alone."""
    codes = "%Y" if time_format is None else re.sub("%[HIMSfpz]", "", time_format)
    return re.search("%[^HIMSfpz%:.]|[yd]", codes) is not None


def is_number(text: str) -> bool:
    """True if a text is a number, also with a decimal comma."""
    return _NUMBER.fullmatch(text) is not None and any(map(str.isdigit, text))


# --- times of a table whose cells have no date


def times_on_days(texts: Sequence[str], first: str) -> list[str]:
    """Times of day with their date, the first row's as given: one that falls by half a day is of the next."""
    try:
        day = datetime.fromisoformat(first)
    except ValueError:
        place, fix = Argument("date"), Argument("date", "2026-12-11")
        raise ConfigError(f"{first!r} is no date", place=place, fix=fix) from None
    before_h, days = 0.0, []
    for text in texts:
        if clock := re.match(r"(\d+)\D(\d\d)[^ap]*([ap]?)", text, re.IGNORECASE):
            hour = int(clock[1]) % 12 + 12 * (clock[3] in "pP") if clock[3] else int(clock[1])
            hour_h = hour + int(clock[2]) / 60
            day += timedelta(days=hour_h < before_h - 12)
            before_h = hour_h
        days.append(f"{day:%Y-%m-%d} {text}")
    return days


_DAY_0, _MOST_DAYS = datetime(1899, 12, 30), 100_000.0  # day 61 is 1900-03-01; to the year 2173


def spreadsheet_moment(days: float) -> datetime:
    """The time on some clock that a spreadsheet counts in days, to the millisecond."""
    return _DAY_0 + timedelta(milliseconds=round(days * 86_400_000.0))


def spreadsheet_time(text: str) -> str:
    """A count of a spreadsheet's days as date and time; any other text as it is."""
    days = float(text.replace(",", ".")) if is_number(text) else _MOST_DAYS
    return f"{spreadsheet_moment(days)}" if abs(days) < _MOST_DAYS else text


def times_from_start(texts: Sequence[str], start: Times, unit_ns: float) -> Times:
    """Times that count from the one time of `start`: numbers of a unit, or hours, minutes and seconds."""
    for error in start.unreadable.values():
        example = Argument("start", "2026-12-11T12:00:00")
        raise ConfigError(error.problem, place=Argument("start"), fix=example)
    known_ns: dict[int, int] = {}
    unreadable: dict[int, ConfigError] = {}
    for row, text in enumerate(texts):
        elapsed = _ELAPSED.fullmatch(_MILLISECONDS.sub(".", text))
        if elapsed or is_number(text):
            hours, minutes, number = elapsed.groups() if elapsed else ("0", "0", text)
            count = int(hours) * 3600 + int(minutes) * 60 + Decimal(number.replace(",", "."))
            since_ns = round(count * Decimal(SECOND_NS if elapsed else unit_ns))
            known_ns[row] = plausible_ns(start.known_ns[0] + since_ns)
        else:
            unreadable[row] = ConfigError("no number of a count", place=repr(text))
    return Times(known_ns, unreadable, start.needed_zone)


# --- of frames, given beside them: in a table, or in the names of their files


GIVE_TIMES = Argument("times", "stamps.csv") + " (file name, time), or " + Argument("time_format")


def given_times_ns(
    frames: Mapping[Path, int], times: Path | None, time_format: str | None, zone: tzinfo | None
) -> dict[Path, list[int]] | None:
    """UTC of each file's frames, in their order, by a table or by its name; None where neither is to be used.

    `frames` has the number in each file, `times` is a table of file name and time with a line per frame;
    `time_format` is that of the times in the file names without their ending, as for strptime, `zone` that of
    times without an offset. Raises `ConfigError` if both are given, a zone without them, or they do not give
    each frame its time.
    """
    if times is not None and time_format is not None:
        problem = "the times of the frames are given in the files' names already"
        raise ConfigError(problem, place=Argument("times"), fix=GIVE_TIMES)
    if times is not None:
        return _from_table(frames, times, zone)
    if time_format is not None:
        return _from_names(frames, time_format, zone)
    if zone is not None:
        fix = "omit " + Argument("zone")
        raise ConfigError("the times in the files are UTC", place=Argument("zone"), fix=fix)
    return None


def _from_table(frames: Mapping[Path, int], times: Path, zone: tzinfo | None) -> dict[Path, list[int]]:
    times_by_path: dict[Path, list[int]] = {path: [] for path in frames}
    by_name = {path.name: path for path in frames}
    rows = [(name, time) for name, time in _rows(times) if name in by_name]
    read = read_times([time for _, time in rows], zone)
    for row, error in read.unreadable.items():  # `time_format` is for names
        fix = "write its times in ISO 8601, such as 2026-12-11T12:00:00+09:00"
        raise ConfigError(error.message, place=f"{times}, {rows[row][0]}", fix=fix)
    for row, (name, _) in enumerate(rows):
        times_by_path[by_name[name]].append(read.known_ns[row])
    wrong = [path for path, count in frames.items() if len(times_by_path[path]) != count]
    if wrong:
        first = f"{len(times_by_path[wrong[0]])} times for the {frames[wrong[0]]} frames of {wrong[0].name}"
        problem = f"does not give each frame of {len(wrong)} files its time: {first}"
        fix = "give every frame a line with its file's name and its time, in their order in the file"
        raise ConfigError(problem, place=times, fix=fix)
    return times_by_path


def _rows(times: Path) -> list[tuple[str, str]]:
    with explained(times, "cannot read", "save it as CSV, UTF-8", OSError, UnicodeDecodeError, csv.Error):
        lines = times.read_text(encoding="utf-8-sig").splitlines()
        # semicolons or tabs part the columns where the first line has them, else commas
        delimiter = next((mark for mark in ";\t" if lines and mark in lines[0]), ",")
        cells = csv.reader(lines, delimiter=delimiter)
        return [(row[0].strip(), row[1].strip()) for row in cells if len(row) >= 2]


def _from_names(frames: Mapping[Path, int], time_format: str, zone: tzinfo | None) -> dict[Path, list[int]]:
    several = next((path for path, count in frames.items() if count > 1), None)
    if several is not None:
        fix = Argument("times", "stamps.csv") + ", with a line for each: file name, time"
        raise ConfigError(f"has {frames[several]} frames, its name only one time", place=several, fix=fix)
    times_ns = parse_times_ns([path.stem for path in frames], zone, time_format)
    return {path: [time_ns] for path, time_ns in zip(frames, times_ns, strict=True)}
