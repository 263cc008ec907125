"""A session over midnight and a change of the clocks in the same night: times have their dates and zones."""

from dataclasses import replace
from datetime import datetime, timedelta
from types import SimpleNamespace
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from benchmarks.drawn_worlds import CLEAR
from fieldkit.estimation.bins import join
from fieldkit.model.clock import utc_ns
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, EventKind, Frame, Reading, Sample
from fieldkit.model.site import Site
from fieldkit.model.units import HOUR_NS, MINUTE_NS
from fieldkit.results.marks import replacement
from fieldkit.results.report import report
from fieldkit.results.slope_map import _window
from fieldkit.sessions.finished_file import add_later_events
from fieldkit.sessions.formats.imported import ImportedRecording, write_imported
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from fieldkit.views import plots, plotting
from fieldkit.views.report import session_figures
from tests.harness.drawn import drawn_world

DENVER = ZoneInfo("America/Denver")
SITE = Site(37.7, -105.9, 2317.0, "America/Denver")
START_NS, END_NS = (utc_ns(datetime(2026, 3, day, hour, tzinfo=DENVER)) for day, hour in ((7, 23), (8, 9)))
"""From 23:00 MST to 09:00 MDT: nine hours, as two o'clock is three o'clock."""
CONFIG = 'schema = 1\n[site]\nlatitude_deg = 37.7\nlongitude_deg = -105.9\ntimezone = "America/Denver"\n'
BOTH = "MST, UTC-07:00, then MDT, UTC-06:00"


@pytest.fixture(scope="module")
def night(tmp_path_factory):
    camera = StreamInfo("camera", "brightness_temperature", "K", (12, 16), 0.01)
    lux = StreamInfo("lux", "illuminance", "lx", (1,))
    counts = np.full((12, 16), 28_000, "<u2") + np.arange(16, dtype="<u2")
    samples: list[Sample] = []
    for at in range(START_NS, END_NS + 1, 30 * 60 * 10**9):
        seq = len(samples) // 2
        samples.append(Frame("camera", at, at, counts, np.zeros((0, 16), "<u2"), seq=seq))
        samples.append(Reading("lux", at, at, (1000.0,), seq=seq))
    path = tmp_path_factory.mktemp("night") / "night.h5"
    header = SessionHeader("night", SITE, (camera, lux), config_toml=CONFIG)
    write_imported(path, header, ImportedRecording(header.streams, samples), "a test")
    return path


def test_the_report_dates_what_is_after_midnight(night, tmp_path):
    page = report(night, tmp_path / "night.html").path.read_text(encoding="utf-8")
    assert f"2026-03-07 23:00 to 2026-03-08 09:00 ({BOTH}), 9 h 00 min" in page
    assert f"time ({BOTH})" in page
    assert ">23:00:00<" in page  # when it was imported, on the first day
    assert f"local time ({BOTH})" in page
    assert "2026-03-08 09:00\n" in page  # the values by minute


@pytest.mark.parametrize(
    ("days", "first"), [(0, "10:00"), (1, "12:00\n2026-03-07"), (6, "00:00\n2026-03-08")]
)
def test_an_axis_of_several_days_has_their_dates(days, first):
    start = datetime(2026, 3, 7, 9, 0, tzinfo=DENVER)
    ends_ns = np.array([utc_ns(start), utc_ns(start + timedelta(days=days, hours=8))])
    figure, (axes,) = plotting.panels(1, 3.0, plotting.WIDE_IN)
    axes.plot(plotting.days(ends_ns), [0.0, 1.0])
    plotting.local_axis(axes, SITE, ends_ns)
    plotting.svg(figure)  # which chooses the ticks
    low, high = axes.get_xlim()
    inside = [tick for tick in axes.get_xticks() if low <= tick <= high]
    assert axes.xaxis.get_major_formatter()(inside[0]) == first
    assert axes.get_xlabel() == f"local time ({BOTH if days else 'MST, UTC-07:00'})"


def test_lines_break_where_nothing_was_measured_for_hours():
    """A straight line through the night would look like a measurement."""
    hours = np.array([9, 10, 11, 33, 34])
    time_ns = START_NS + hours * HOUR_NS
    found = plots.TiltSeries(hours + 0.0, hours - 1.0, hours + 1.0, np.nan)
    axes = plots.tilts(time_ns, {"b15": found}, SITE)
    (line,), (band,) = axes.lines, axes.collections
    np.testing.assert_array_equal(np.isnan(line.get_ydata()), [False, False, False, True, False, False])
    assert len(band.get_paths()) == 2


def test_a_cloud_of_the_evening_does_not_last_until_the_morning():
    time_ns = START_NS + np.array([0, 1, 900, 901]) * MINUTE_NS
    columns = SimpleNamespace(time_ns=time_ns, cloudy=np.array([False, True, False, False]))
    _, (axes,) = plotting.panels(1, 3.0)
    session_figures._shade_clouds(axes, columns)
    (cloud,) = axes.patches
    assert cloud.get_width() == pytest.approx(1.0 / 1440.0, rel=1e-6)


def test_a_clock_time_that_edits_a_mark_is_the_nearest_to_the_mark(tmp_path):
    """It was the last one of the session: a shade test of the first day moved to the third."""
    lux, path = StreamInfo("lux", "illuminance", "lx", (1,)), tmp_path / "days.h5"
    times_ns = [START_NS + hours * HOUR_NS for hours in (0, 24, 60)]
    readings = [Reading("lux", at, at, (1000.0,), seq=seq) for seq, at in enumerate(times_ns)]
    header = SessionHeader("days", SITE, (lux,), config_toml=CONFIG)
    write_imported(path, header, ImportedRecording(header.streams, readings), "a test")
    noted_ns = START_NS + 30 * MINUTE_NS
    add_later_events(path, [Event(EventKind.MARK, noted_ns, noted_ns, "gust")])
    with open_session(path) as session:
        assert replacement(session, "gust", at="23:25").at == "2026-03-07T23:25:00-07:00"
        edit = replacement(session, "gust", at="23:55", to="00:05")
        assert (edit.at, edit.to) == ("2026-03-07T23:55:00-07:00", "2026-03-08T00:05:00-07:00")


def test_a_map_of_the_learned_model_is_of_the_last_day():
    """Its covariances are of all minutes by all: those of three days took gigabytes."""
    world = drawn_world(5, CLEAR, minutes=20)
    day, learned = world.history, replace(world.settings, model="learned")
    moved = {"minute": day.minute + 1440, "time_ns": day.time_ns + 1440 * MINUTE_NS}
    known = SimpleNamespace(
        settings=learned, regions=world.regions, history=join([day, replace(day, **moved)])
    )
    np.testing.assert_array_equal(_window(known, [], "all"), np.arange(20, 40))
    known.history = replace(day, minute=day.minute[0] + 100 * np.arange(20))
    np.testing.assert_array_equal(_window(known, [], "all"), np.arange(5, 20))
    known.settings = replace(learned, model="full")
    np.testing.assert_array_equal(_window(known, [], "all"), np.arange(20))
