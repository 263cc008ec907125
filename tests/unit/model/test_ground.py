"""The nouns that every room uses: sites, regions, clocks and streams."""

import os
import time
import zoneinfo
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from fieldkit.model.clock import HostClock
from fieldkit.model.device import StreamInfo
from fieldkit.model.site import Region, RegionKind, zone_by_longitude

CAMERA = StreamInfo("ir", "brightness_temperature", "K", (120, 160), scale=0.01, offset=0.0)
METER = StreamInfo("lux", "illuminance", "lx", (1,))


@pytest.mark.parametrize(
    ("longitude_deg", "hours"),
    [(139.4, 9), (-105.9, -7), (0.0, 0), (7.6, 1), (-7.4, 0), (172.6, 12), (187.4, -12), (-187.4, 12)],
)
def test_a_zone_by_longitude_is_that_far_from_utc(longitude_deg, hours):
    """Nautical time: 15 degrees are an hour, and the date line parts +12 from -12."""
    zone = zoneinfo.ZoneInfo(zone_by_longitude(longitude_deg))
    assert datetime(2026, 7, 1, tzinfo=UTC).astimezone(zone).utcoffset() == timedelta(hours=hours)


def square(low: float, high: float) -> Region:
    return Region("bed", RegionKind.TARGET, ((low, low), (high, low), (high, high), (low, high)))


def test_a_region_holds_the_pixels_on_its_edge_and_none_beyond():
    mask = square(2.0, 5.0).mask((8, 9))
    assert mask.shape == (8, 9)
    rows, cols = np.nonzero(mask)
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == (2, 5, 2, 5)
    assert mask.sum() == 16


def test_pixels_on_the_line_of_an_edge_but_beyond_its_end_are_outside():
    mask = Region("bed", RegionKind.TARGET, ((2.5, 3.0), (7.5, 3.0), (7.5, 6.0), (2.5, 6.0))).mask((9, 10))
    assert np.flatnonzero(mask[3]).tolist() == np.flatnonzero(mask[6]).tolist() == [3, 4, 5, 6, 7]


def test_a_triangle_holds_its_corners_and_half_of_its_square():
    mask = Region("bed", RegionKind.TARGET, ((1.0, 1.0), (7.0, 1.0), (1.0, 7.0))).mask((9, 9))
    expected = np.array([[x >= 1 and y >= 1 and x + y <= 8 for x in range(9)] for y in range(9)])
    assert (mask == expected).all()


@pytest.mark.parametrize(
    ("x", "y", "fits"),
    [(159, 119, True), (160, 119, False), (159, 120, False), (-1, 5, False), (5, -0.5, False), (0, 0, True)],
)
def test_a_region_one_pixel_outside_the_picture_is_not_within_it(x, y, fits):
    region = Region("bed", RegionKind.TARGET, ((x, y), (10.0, 10.0), (20.0, 10.0)))
    assert region.is_within((120, 160)) is fits


def test_the_computers_clock_tells_utc():
    clock = HostClock()
    before = time.time_ns()
    now = clock.to_utc_ns(clock.mono_ns())
    assert before - 50_000_000 <= now <= time.time_ns() + 50_000_000


def test_the_tightest_of_several_comparisons_is_taken(monkeypatch):
    """A comparison that was held up by 30 ms knows the time half of that worse; its middle is as good."""
    mono, utc = 5_000_000_000, 1_700_000_000_000_000_000
    delays = [30_000_000, 200, 40_000_000, 10_000, *[50_000_000] * 4]
    stamps = iter([stamp for delay in delays for stamp in (mono, mono + delay)])
    middles = iter([utc + delay // 2 for delay in delays])
    # when a comparison is held up, and for how long, is the kernel's choice
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(stamps))
    monkeypatch.setattr(time, "time_ns", lambda: next(middles))
    check = HostClock().anchor
    assert next(stamps, None) is None  # all eight were made
    assert (check.error_ns, check.utc_minus_mono_ns) == (100, utc - mono)
    assert check.mono_ns == mono + 100


def test_the_clock_counts_how_long_the_computer_slept():
    if not hasattr(time, "CLOCK_BOOTTIME"):
        pytest.skip("only Linux counts the time asleep")
    expected = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    assert HostClock().check().suspended_ns == pytest.approx(expected, abs=50_000_000)


def test_time_asleep_is_what_the_monotonic_clock_lacks(monkeypatch):
    clocks = {time.CLOCK_BOOTTIME: 9_000, time.CLOCK_MONOTONIC: 2_000}
    # a test does not put a computer to sleep
    monkeypatch.setattr(time, "clock_gettime_ns", clocks.__getitem__)
    assert HostClock().check().suspended_ns == 7_000


def test_the_clock_waits_as_long_as_it_was_told_for_bytes():
    reading, writing = os.pipe()
    try:
        clock = HostClock()
        began = time.monotonic()
        assert not clock.wait_readable(reading, 0.08)
        assert time.monotonic() - began > 0.06
        os.write(writing, b"x")
        assert clock.wait_readable(reading, 5.0)
    finally:
        os.close(reading)
        os.close(writing)


def test_streams_know_what_fits_into_them():
    assert CAMERA.is_camera
    assert not METER.is_camera
    assert METER.has_the_columns_of(replace(METER, serial_number="another", driver="lutron"))
    assert not METER.has_the_columns_of(replace(METER, unit="W m-2"))
    assert not METER.has_the_columns_of(replace(METER, channels=("a",)))
    assert not CAMERA.has_the_columns_of(replace(CAMERA, shape=(60, 80)))
    assert not CAMERA.has_the_columns_of(replace(CAMERA, metadata_shape=(2, 160)))
    assert CAMERA.has_the_columns_of(replace(CAMERA, unit="counts"))


@pytest.mark.parametrize("change", [{"offset": 10.0}, {"scale": 0.1}, {"law": "ht301"}])
def test_numbers_of_another_law_scale_or_offset_do_not_mean_the_same(change):
    assert CAMERA.is_read_as(replace(CAMERA, serial_number="another"))
    assert not CAMERA.is_read_as(replace(CAMERA, **change))  # type: ignore[arg-type]
    unknown = replace(CAMERA, scale=float("nan"))
    assert unknown.is_read_as(unknown)
