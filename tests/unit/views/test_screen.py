import io
import re
from dataclasses import replace

import pytest
from rich.cells import cell_len
from rich.console import Console
from rich.screen import Screen

from fieldkit.model.samples import Event, EventKind, Health, Reading, Severity, StreamHealth
from fieldkit.views.frame_image import OUTLINE
from fieldkit.views.latest import Latest
from fieldkit.views.screen import THEMES, screen
from tests.harness.learnt import learnt

SECOND_NS = 10**9
START_NS = 1_512_961_680 * SECOND_NS  # as in conftest
SIZES = [(80, 24), (100, 30), (120, 40), (200, 60)]
SMALL_SIZES = [(46, 24), (44, 24), (40, 20), (80, 8), (80, 5), (30, 10), (10, 3), (1, 1)]


@pytest.fixture
def latest(site, regions, streams, frame, make_minute):
    """One hour into a recording of three."""
    latest = Latest(site, regions, streams, "three-beds", START_NS + 3 * 3600 * SECOND_NS)
    latest.update(Event(EventKind.START, 0, START_NS, "recording 20171211T030800Z-three-beds"))
    for second in (3599, 3600):
        now = START_NS + second * SECOND_NS
        counts = (StreamHealth("camera", 9 * second, 0, 0), StreamHealth("lux", second, 2, 0, rejected=3))
        latest.update(Health(now, now, counts, 11_200_000_000, 9_100_000))
    latest.update(frame._replace(time_ns=now))
    latest.update(Reading("lux", now, now, (55_210.0,)))
    latest.update(Reading("thermometer", now, now, (300.05, float("nan"))))
    latest.update(make_minute(60))
    return latest


def drawn(latest: Latest, cols: int, rows: int, theme: str = "dark", **console: object) -> str:
    given = {"force_terminal": True, "color_system": "truecolor", "legacy_windows": False, **console}
    paper = Console(file=io.StringIO(), width=cols, height=rows, **given)
    with paper.use_theme(THEMES[theme]):
        paper.print(Screen(screen(latest, cols, rows), style="base"), end="")
    return paper.file.getvalue()


def letters(latest: Latest, cols: int, rows: int) -> list[str]:
    return drawn(latest, cols, rows, color_system=None).splitlines()


@pytest.mark.parametrize(("cols", "rows"), SIZES)
def test_what_the_data_taught_is_shown_with_how_much_they_said(latest, make_minute, cols, rows):
    latest.update(make_minute(60, learnt=learnt(60)))
    lines = letters(latest, cols, rows)
    assert {cell_len(line) for line in lines} == {cols}
    text = "\n".join(lines)
    if rows < 30:
        assert "gain 0.94 ██░ " in text
        assert "depth 3.6 cm █░░" in text
        assert "inertia 520 ██░ exchange 21 ██░" in text
    else:
        assert re.search(r"inertia +520 \(460 to 588\) +██████░░ 70%", text)
        assert re.search(r"depth, cm +3\.6 \(2\.3 to 5\.7\) +████░░░░ 45%", text)
    assert "correlated: b25 0.41" in text
    latest.update(make_minute(61, learnt=replace(learnt(60), autocorrelation={"b25": 0.1})))
    assert re.search(r"residuals +uncorrelated", "\n".join(letters(latest, cols, rows)))


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize(("cols", "rows"), SMALL_SIZES)
def test_a_terminal_without_room_for_the_picture_shows_the_rest(latest, cols, rows, seen):
    latest.frames = latest.frames if seen else {}
    lines = letters(latest, cols, rows)
    assert len(lines) == rows
    assert {cell_len(line) for line in lines} == {cols}


@pytest.mark.parametrize(("cols", "rows"), SIZES)
def test_shows_what_the_field_needs_in_every_size(latest, cols, rows):
    lines = letters(latest, cols, rows)
    assert (len(lines), {cell_len(line) for line in lines}) == (rows, {cols})
    text = "\n".join(lines)
    for needed in (
        "three-beds", "2017-12-11 13:08:00 JST, UTC+09:00", "55 210 lx", "835 W/m²", "eq10 /0.44",
        "zenith 58.8°", "azimuth 186.6°", "flat 26.9  b15 –", "9.0/s", "lost 2 garbled 3", "11.2 GB free",
        "26.85", "15.5 ±1.5", "178 ±10", "0.33", "ok", "not resolved, or 43.3°/181°", "reference",
        "recording 20171211T030800Z-three-beds", "1 h 00 min of 3 h 00 min, ends 15:08, Ctrl-C stops",
        "°C brightness", "surface",
    ):  # fmt: skip
        assert needed in text, needed


def test_before_the_first_minute_beds_show_what_the_picture_sees(latest):
    latest.minute = None
    counts = latest.frame.counts.copy()
    bed = next(region for region in latest.regions if region.name == "b15")
    counts[bed.mask((counts.shape[0], counts.shape[1]))] = 30_215
    latest.update(latest.frame._replace(counts=counts))
    line = next(line for line in letters(latest, 80, 24) if line.startswith("b15"))
    assert "29.00" in line  # 302.15 K
    assert "brightness" in line


def test_regions_are_outlined_and_named(latest):
    coloured = drawn(latest, 80, 24)
    assert "38;2;{};{};{}".format(*OUTLINE) in coloured
    lines = [line for line in letters(latest, 80, 24) if line.startswith("▀▀▀")]
    for name in ("flat", "b15", "b25"):
        assert any(name in line for line in lines)
    assert "b25" in lines[1] + lines[2]  # the upper right bed of the picture


def test_bad_news_is_told_in_words_and_in_red(latest):
    latest.update(Event(EventKind.DISK, 1, 1, "disk full", severity=Severity.ERROR))
    assert "ERROR: disk full" in "\n".join(letters(latest, 80, 24))
    assert "41m" in drawn(latest, 80, 24)


def test_a_stream_that_is_silent_says_since_when(latest):
    now = START_NS + 3700 * SECOND_NS
    latest.update(Health(now, now, (StreamHealth("camera", 9 * 3600, 0, 0),), 10**9))
    (line,) = [line for line in letters(latest, 80, 24) if " camera " in line]
    assert "2 min ago" in line


def test_clock_is_steady_until_it_is_not(latest):
    assert "steady since 12:08" in "\n".join(letters(latest, 80, 24))
    latest.update(Event(EventKind.CLOCK_STEP, 1, START_NS, "clock step"))
    assert "12:08 clock step" in "\n".join(letters(latest, 80, 24))


@pytest.mark.parametrize(("cols", "rows"), SIZES)
def test_times_of_other_days_have_their_dates(latest, cols, rows):
    now, latest.planned_end_ns = START_NS + 26 * 3600 * SECOND_NS, START_NS + 72 * 3600 * SECOND_NS
    latest.update(Reading("lux", now, now, (1.0,)))
    latest.update(Event(EventKind.MARK, now, now, "dawn"))
    lines = letters(latest, cols, rows)
    assert {cell_len(line) for line in lines} == {cols}
    text = "\n".join(lines)
    assert "steady since 2017-12-11 12:08" in text
    assert re.search("26 h 00 .*72 h 00 .*2017-12-14 12:08", text)
    assert "\n2017-12-11 12:08:00  recording" in text
    assert "\n14:08:00  mark dawn" in text


def test_newest_events_are_last_and_old_ones_go(latest):
    for number in range(20):
        latest.update(Event(EventKind.MARK, 1, START_NS + number, f"mark number {number:02d}"))
    text = "\n".join(letters(latest, 80, 24))
    assert text.index("mark number 18") < text.index("mark number 19")
    assert "mark number 10" not in text


@pytest.mark.parametrize(("cols", "rows"), [(60, 24), (60, 20), (80, 24)])
def test_regions_without_room_are_counted_not_dropped_in_silence(site, streams, regions, frame, cols, rows):
    many = tuple(replace(regions[1], name=f"bed{number}") for number in range(9))
    crowded = Latest(site, many, streams)
    crowded.update(frame)
    lines = letters(crowded, cols, rows)
    shown = sum(line.startswith("bed") for line in lines)
    assert 0 < shown < 9
    (hint,) = [line for line in lines if "hidden" in line]
    more_rows = 9 - (rows - 18)
    assert re.findall(r"\d+", hint) == [str(9 - shown), str(more_rows)]
    enlarged = letters(crowded, cols, rows + more_rows)
    assert sum(line.startswith("bed") for line in enlarged) == 9


def test_a_mark_of_the_past_stands_in_its_place_and_says_its_kind(latest):
    end_ns = START_NS + 600 * SECOND_NS
    latest.update(Event(EventKind.DISK, 1, START_NS + 3000 * SECOND_NS, "disk reserve near"))
    span = {"label": "cloud", "end_ns": end_ns}
    latest.update(Event(EventKind.MARK, 1, end_ns - 180 * SECOND_NS, "over the ridge", data=span))
    lines = letters(latest, 80, 24)
    first, last = (next(n for n, line in enumerate(lines) if text in line) for text in ("ridge", "reserve"))
    assert first < last
    assert "cloud, 3 min" in lines[first]


def test_a_camera_without_a_temperature_scale_shows_counts(site, regions, streams, frame):
    latest = Latest(site, regions, (replace(streams[0], scale=float("nan")), *streams[1:]))
    latest.update(frame)
    assert "counts" in "\n".join(letters(latest, 80, 24))
