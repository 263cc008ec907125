"""The light of a session against the sun: pvlib's clear sky over Sagamihara, its clock right or wrong."""

from pathlib import Path

import numpy as np
import pandas
import pvlib
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.finding import Finding
from fieldkit.model.samples import Quality, Reading
from fieldkit.model.site import Site
from fieldkit.sessions.analysis import minute_means
from fieldkit.sessions.check import check
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.formats.imported import ImportedRecording, write_imported
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.time_map import TimeStep

SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
LUX = StreamInfo("lux", "illuminance", "lx", (1,), rate_hz=1 / 60)
NINE_TO_THREE = np.datetime64("2017-08-30T00:00", "ns").astype(np.int64) + np.arange(360) * 60 * 10**9
HOUR_NS = 3600 * 10**9


def clear_light_lx(time_ns: np.ndarray) -> np.ndarray:
    """A flat meter under Haurwitz's cloudless sky, 110 lm/W, with the sun of NREL's SPA, both by pvlib."""
    stamps = pandas.DatetimeIndex(time_ns.astype("datetime64[ns]"), tz="UTC")
    sun = pvlib.solarposition.get_solarposition(stamps, SITE.latitude_deg, SITE.longitude_deg)
    ghi = pvlib.clearsky.haurwitz(sun["apparent_zenith"])["ghi"].to_numpy()
    return np.asarray(110.0 * ghi, np.float64)


def session(path: Path, time_ns: np.ndarray, lux: np.ndarray) -> Path:
    readings = [
        Reading("lux", at, at, (value,)) for at, value in zip(time_ns.tolist(), lux.tolist(), strict=True)
    ]
    header = SessionHeader("light", SITE, (LUX,))
    write_imported(path, header, ImportedRecording((LUX,), readings), "a test")
    return path


def sun_finding(path: Path) -> Finding | None:
    found = [finding for finding in check(path) if finding.what == "sun"]
    return found[0] if found else None


def test_light_at_its_own_time_fits(tmp_path):
    found = sun_finding(session(tmp_path / "a.h5", NINE_TO_THREE, clear_light_lx(NINE_TO_THREE)))
    assert found is not None
    assert (found.level, "recorded" in found.text) == ("ok", True)


@pytest.mark.parametrize("hours_behind", [2, 9])
def test_a_corrected_clock_fits(tmp_path, hours_behind):
    path = session(tmp_path / "a.h5", NINE_TO_THREE - hours_behind * HOUR_NS, clear_light_lx(NINE_TO_THREE))
    apply_time_map(path, [TimeStep(0, hours_behind * HOUR_NS, "another clock")])
    with open_session(path) as opened:
        assert len(minute_means(opened, "lux")[0]) == len(NINE_TO_THREE)
    found = sun_finding(path)
    assert found is not None
    assert (found.level, "corrected" in found.text) == ("ok", True)


@pytest.mark.parametrize(
    ("hours_behind", "told"),
    [
        (-3, "-180 min"),
        (2, "+120 min"),
        (9, "+540 min"),  # all of it at night, where there can be no such light
    ],
)
def test_a_wrong_zone_is_told_with_what_to_add(tmp_path, hours_behind, told):
    recorded_ns = NINE_TO_THREE - hours_behind * HOUR_NS
    found = sun_finding(session(tmp_path / "a.h5", recorded_ns, clear_light_lx(NINE_TO_THREE)))
    assert found is not None
    assert found.level == "warn"
    assert f"best at {told}" in found.text


@pytest.mark.parametrize("minutes", [55, pytest.param(30, marks=pytest.mark.slow)])
def test_less_than_an_hour_says_nothing_of_the_clock(tmp_path, minutes):
    time_ns = NINE_TO_THREE[:minutes]
    found = sun_finding(session(tmp_path / "a.h5", time_ns - 2 * HOUR_NS, clear_light_lx(time_ns)))
    assert found is not None
    assert (found.level, "fits" in found.text) == ("ok", False)


def test_a_night_says_nothing_at_all(tmp_path):
    assert sun_finding(session(tmp_path / "a.h5", NINE_TO_THREE, np.full(360, 0.2))) is None


def test_minute_means_count_every_usable_reading_once(tmp_path):
    start = int(NINE_TO_THREE[0])
    values = {0: 10.0, 20: 20.0, 40: 60.0, 60: 7.0, 80: 5000.0, 100: 9.0, 130: float("nan")}
    readings = [
        Reading("lux", start + s * 10**9, start + s * 10**9, (value,),
                quality=Quality.OVERRANGE if value == 5000.0 else Quality.GOOD)
        for s, value in values.items()
    ]  # fmt: skip
    write_imported(
        tmp_path / "a.h5", SessionHeader("l", SITE, (LUX,)), ImportedRecording((LUX,), readings), "a test"
    )
    with open_session(tmp_path / "a.h5") as opened:
        time_ns, means = minute_means(opened, "lux")
    assert means.tolist() == [30.0, 8.0]
    assert (time_ns - start).tolist() == [30 * 10**9, 90 * 10**9]


def test_the_mean_of_directions_around_north_is_north(tmp_path):
    start = int(NINE_TO_THREE[0])
    vane = StreamInfo("vane", "wind_direction", "degree", (1,))
    readings = [
        Reading("vane", start + s * 10**9, start + s * 10**9, (value,))
        for s, value in ((0, 350.0), (20, 10.0))
    ]
    header = SessionHeader("l", SITE, (vane,))
    write_imported(tmp_path / "a.h5", header, ImportedRecording((vane,), readings), "a test")
    with open_session(tmp_path / "a.h5") as opened:
        _, means = minute_means(opened, "vane")
    assert (means + 180.0) % 360.0 == pytest.approx([180.0])
