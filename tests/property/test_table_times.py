"""Times of generated tables by zone, shape, marks of numbers, damage: no difference from pandas is silent.

A table is read as pandas has its frame, or refused for what is missing and then read with that option.
"""

from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from fieldkit.sessions.formats.imported import MissingOptionsError
from tests.harness.logs import notes, read, readings
from tests.harness.next_steps import steps

ZONES = ["Europe/Berlin", "America/Denver", "Asia/Kathmandu", "Australia/Adelaide", "UTC"]
WINDOWS = {
    # CLDR's windowsZones, of zones with summer time and without
    "Europe/Berlin": "W. Europe Standard Time",
    "America/Denver": "Mountain Standard Time",
    "Asia/Kathmandu": "Nepal Standard Time",
    "Australia/Adelaide": "Cen. Australia Standard Time",
    "UTC": "UTC",
}
HEADS = ["time", "Zeit", "Fecha Tiempo", "Date Time", "日時", "Timestamp"]


def offset_of(index: pd.DatetimeIndex) -> tuple[float, str]:
    """Hours ahead of UTC, and as +hh:mm."""
    hours = index[0].utcoffset() / pd.Timedelta("1h")
    return hours, f"{'-' if hours < 0 else '+'}{int(abs(hours)):02}:{round(abs(hours) % 1 * 60):02}"


@st.composite
def tables(draw):
    """Text of a table, its truth as a series, the options that are asked for, words that notes must have."""
    name = draw(st.sampled_from(ZONES))
    start = pd.Timestamp(draw(st.sampled_from(["2026-06-11", "2026-01-20"])), tz=name)
    start += pd.Timedelta(minutes=draw(st.integers(0, 1430)))
    step_s = draw(st.sampled_from([1, 10, 60, 600]))
    count = draw(st.integers(3, 12))
    index = pd.date_range(start, periods=count, freq=f"{step_s}s")
    lux = pd.Series(np.round(np.linspace(1000.0, 98_765.4, count), 1), index)
    shape = draw(
        st.sampled_from(["one", "two", "parts", "hhmm", "half", "unpadded", "clock", "count", "ms", "own"])
    )
    if shape in ("hhmm", "parts") and step_s < 60:
        shape = "one"
    if shape == "ms":
        lux.index = index = index + pd.Timedelta(milliseconds=draw(st.integers(0, 999)))
    times, asked = cells_of_times(draw, shape, index)
    words, field = stated(draw, name, index)
    if shape == "own":
        words, field = "", ""
    elif (
        not (words or field)
        or ("Standard Time" in field and index[0].dst())
        or ("GMT offset" in field and "+0" not in field)
    ):
        asked |= {"zone": ZoneInfo(name)}
    mark = draw(st.sampled_from([",", ";", "\t"]))
    thousands = draw(st.sampled_from(["", "'", "\u202f", "\u00a0", "’"]))
    comma = "," if mark == ";" else "."
    numbers = [f"{value:,.1f}".replace(",", "T").replace(".", comma).replace("T", thousands) for value in lux]
    head = [f"{times[0][0]}{words}", *times[0][1:]]
    rows = [mark.join([*head, "light [lx]"])]
    rows += [mark.join([*row, number]) for row, number in zip(times[1:], numbers, strict=True)]
    text, named = damaged(draw, [field, *rows] if field else rows)
    return text, lux, asked, named


def cells_of_times(draw, shape: str, index: pd.DatetimeIndex) -> tuple[list[list[str]], dict[str, object]]:
    """Header and rows of the time's columns, and the options that this shape needs."""
    head, asked = draw(st.sampled_from(HEADS)), {}
    form = {"one": "%Y-%m-%d %H:%M:%S", "half": "%Y-%m-%d %I:%M:%S %p", "own": "%Y-%m-%dT%H:%M:%S%z"}.get(
        shape
    )
    if form:
        return [[head], *([text] for text in index.strftime(form))], asked
    if shape == "two":
        return [["Date", "Time"], *([f"{t:%Y/%m/%d}", f"{t.hour}:{t:%M:%S}"] for t in index)], asked
    if shape == "parts":
        names = draw(
            st.sampled_from(
                ["Year Month Day Hour Minute", "Jahr Monat Tag Stunde Minute", "YYYY MM DD hh mm"]
            )
        )
        return [
            names.split(),
            *([str(part) for part in (t.year, t.month, t.day, t.hour, t.minute)] for t in index),
        ], asked
    if shape == "hhmm":
        return [["date", "HHMM"], *([f"{t:%Y-%m-%d}", str(t.hour * 100 + t.minute)] for t in index)], asked
    if shape == "unpadded":
        asked = {"time_format": "%d/%m/%Y %H%M%S"}
        return [["when"], *([f"{t.day}/{t.month}/{t.year} {t:%H%M%S}"] for t in index)], asked
    if shape == "clock":
        return [[head], *([f"{t:%H:%M:%S}"] for t in index)], {"date": f"{index[0]:%Y-%m-%d}"}
    if shape == "count":
        unit, each_s = draw(st.sampled_from([("s", 1), ("ms", 0.001), ("min", 60)]))
        counts = [(t - index[0]).total_seconds() / each_s for t in index]
        return [[f"t ({unit})"], *([repr(count)] for count in counts)], {
            "start": f"{index[0]:%Y-%m-%dT%H:%M:%S}"
        }
    return [[head, "ms"], *([f"{t:%Y-%m-%d %H:%M:%S}", str(t.microsecond // 1000)] for t in index)], asked


STATED = [
    ("", ""),
    (" (UTC{offset})", ""),
    (" [GMT{offset}]", ""),
    (" ({name})", ""),
    ("", "Time zone: {name}"),
    ("", "utc_offset_seconds: {seconds:.0f}"),
    ("", "time_zone: {offset}"),
    ("", "GMT offset: {minutes:+.0f}"),
    ("", "Time zone: {windows}"),
]


def stated(draw, name: str, index: pd.DatetimeIndex) -> tuple[str, str]:
    """Words on the zone behind the time's header, or a field above it; some of which leave it open."""
    hours, offset = offset_of(index)
    facts = {"name": name, "offset": offset, "windows": WINDOWS[name]}
    words, field = draw(st.sampled_from(STATED))
    return words.format(**facts), field.format(**facts, seconds=hours * 3600, minutes=hours * 60)


def damaged(draw, rows: list[str]) -> tuple[str, str]:
    """The lines with damage that leaves every row whole, and words that name it."""
    kind = draw(st.sampled_from(["", "", "zeros", "cut", "head"]))
    text = "".join(f"{row}\n" for row in rows)
    if kind == "zeros":
        return text + "\0" * draw(st.integers(8, 600)), "zeros"
    if kind == "cut":
        return text + rows[-1][: draw(st.integers(1, 3))], f"row {len(rows) + 1}"
    if kind == "head":
        return f"{text}{next(row for row in rows if 'light' in row)}\n", f"row {len(rows) + 1}"
    return text, ""


@settings(
    max_examples=200,
    deadline=None,
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(tables())
def test_times_of_generated_tables_are_those_of_pandas_or_asked_for(tmp_path, table):
    text, truth, asked, named = table
    options = {"zone": None, **{key: value for key, value in asked.items() if key == "time_format"}}
    if missing := asked.keys() - options.keys() | ({"zone"} if "zone" in asked else set()):
        with pytest.raises(MissingOptionsError) as caught:
            read(tmp_path, text, **options)
        first = [step.name for step in steps(caught.value)]
        assert missing & set(first), text
    imported = read(tmp_path, text, **{**options, **asked})
    rows = {
        row.time_ns: row.values[0]
        for row in readings(imported, "log") or readings(imported, "log-illuminance")
    }
    expected = dict(
        zip(truth.index.tz_convert("UTC").as_unit("ns").asi8.tolist(), truth.tolist(), strict=True)
    )
    assert rows == expected, text
    assert named in notes(imported)
