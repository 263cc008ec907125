"""What quantities can be: expected values from records and standards, not from the table itself."""

import re

import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.limits import bounds_of, changed_rows, excesses, flag_implausible, labels_of
from fieldkit.model.samples import Frame, Quality, Reading
from fieldkit.model.site import Site
from fieldkit.physics.sun import sun_vectors
from fieldkit.weather import packaged_day

STREAMS = {
    "air": StreamInfo("logger", "temperature", "K", (1,), channels=("air",)),
    "probe": StreamInfo("thermometer", "temperature", "K", (1,), channels=("T1",)),
    "camera": StreamInfo("camera", "brightness_temperature", "K", (2, 2), 0.01),
    "lux": StreamInfo("lux", "illuminance", "lx", (1,)),
    **{
        word: StreamInfo(word, "irradiance", "W m-2", (1,), measures=(word,))
        for word in ("dni", "ghi", "gti", "dhi", "longwave_down", "longwave_up")
    },
    "unknown": StreamInfo("sun", "irradiance", "W m-2", (1,)),
    "wind": StreamInfo("wind", "wind_speed", "m s-1", (1,)),
}


def exceeds(name: str, value: float, sine: float | None = None) -> bool:
    return bool(bounds_of(STREAMS[name]).is_exceeded(np.array([[value]]), sine).any())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("air", 273.15 - 89.2),  # Vostok, 1983
        ("air", 273.15 + 56.7),  # Death Valley, 1913
        ("probe", 273.15 + 80.8),  # satellite maximum of the Lut desert
        ("probe", 273.15 + 120.0),  # a black plate on insulation
        ("camera", 273.15 - 30.0),
        ("lux", 0.0),
        ("lux", 130_000.0),  # direct sun and bright clouds
        ("dni", 1150.0),  # Mauna Loa
        ("ghi", 1891.0),  # cloud enhancement measured at 1 s, La Paz
        ("gti", 1891.0),
        ("dhi", 700.0),
        ("ghi", -8.0),  # a ventilated pyranometer at night
        ("unknown", -150.0),  # net radiation at night
        ("longwave_down", 120.0),  # Antarctic plateau
        ("longwave_up", 850.0),
        ("wind", 113.2),  # Barrow Island, 1996
        *((name, np.nan) for name in STREAMS),
    ],
)
def test_what_was_measured_somewhere_is_possible(name, value):
    assert not exceeds(name, value)


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.parametrize(
    "value",
    [
        -7999.0, 7999.0, -6999.0, 6999.0, -99999.0,  # Campbell Scientific: NAN and over range
        -9999.9, -999.9, -9999.0,  # SURFRAD, ISD
        -32768.0, 3276.7 * 1e3,  # 16-bit registers
        9.9e37, 9.91e37, -9.9e37,  # SCPI: over range and not a number
        np.inf, -np.inf,
    ],
)  # fmt: skip
def test_what_stands_for_no_value_is_impossible(name, value):
    is_light = name == "lux" and 0.0 <= value <= 10_000.0  # a light may be of 7999 lx
    assert exceeds(name, value) != is_light


@pytest.mark.parametrize(
    ("name", "value"),
    [("lux", -5.0), ("probe", 0.0), ("air", 273.15 - 99.9), ("probe", 273.15 - 127.0), ("wind", -0.1),
     ("dni", 1600.0), ("longwave_down", -5.0), ("camera", 0.0)],
)  # fmt: skip
def test_what_no_surface_or_sky_has_is_impossible(name, value):
    assert exceeds(name, value)


def test_light_of_level_ground_is_limited_by_the_height_of_the_sun():
    """BSRN, physically possible, for a sine of 0.2 and 1408 W/m2 of sun."""
    assert pytest.approx(406.3, abs=0.5) == 1.5 * 1408 * 0.2**1.2 + 100
    assert not exceeds("ghi", 405.0, 0.2)
    assert exceeds("ghi", 408.0, 0.2)
    assert pytest.approx(244.0, abs=0.5) == 0.95 * 1408 * 0.2**1.2 + 50
    assert exceeds("dhi", 245.5, 0.2)
    assert exceeds("ghi", 120.0, -0.3)  # at night
    assert not exceeds("gti", 900.0, 0.2)  # a plane that faces the low sun
    assert not exceeds("dni", 900.0, 0.2)


def test_no_beam_comes_from_a_sun_that_is_down():
    """Alamosa, 2016-01-01, from before sunrise to after sunset: what SURFRAD measured is possible."""
    weather = packaged_day()
    site = Site(37.6969, -105.9231, 2317.0)  # of the station's file
    sine = sun_vectors(weather.time_ns, site)[:, 2]
    assert sine.min() < -0.05 < 0.45 < sine.max()
    assert not bounds_of(STREAMS["dni"]).is_exceeded(weather.dni_w_m2[:, np.newaxis], sine).any()
    for name, value in (("dni", 300.0), ("lux", 30_000.0)):  # as where the clock is off by half a day
        assert exceeds(name, value, -0.3)
        assert not exceeds(name, value, 0.02)
    bounds = bounds_of(STREAMS["dni"])
    values = np.array([[300.0]])
    (found,) = excesses(labels_of(STREAMS["dni"]), bounds, values, bounds.is_exceeded(values, -0.3))
    assert found.words("row 1").endswith("place and time right?")


def test_a_row_that_is_stated_replaces_the_table():
    hot = changed_rows({"probe_temperature_c": (-20.0, 300.0), "ghi_w_m2": (-10.0, 3000.0)}, "earth")
    plate = np.array([[273.15 + 250.0], [273.15 - 30.0]])
    assert bounds_of(STREAMS["probe"], hot).is_exceeded(plate)[:, 0].tolist() == [False, True]
    assert not bounds_of(STREAMS["ghi"], hot).is_exceeded(np.array([[2900.0]]), 0.1).any()


def test_a_row_that_is_stated_replaces_the_limits_of_a_stream():
    own = StreamInfo(
        "logger", "temperature", "K", (1,), channels=("T1",), limits={"probe_temperature": (250.0, 330.0)}
    )
    hot = changed_rows({"probe_temperature_c": (-20.0, 300.0)}, "earth")
    values = np.array([[400.0], [600.0]])
    assert bounds_of(own).is_exceeded(values)[:, 0].tolist() == [True, True]
    assert bounds_of(own, hot).is_exceeded(values)[:, 0].tolist() == [False, True]


def test_other_worlds_are_colder():
    """The Moon's night is 95 K at the equator, the shadows at its poles 25 K (Paige et al., 2010)."""
    moon = bounds_of(STREAMS["camera"], changed_rows({}, "moon"))
    assert moon.is_exceeded(np.array([[95.0], [25.0], [10.0]]))[:, 0].tolist() == [False, False, True]
    assert (
        not bounds_of(STREAMS["longwave_down"], changed_rows({}, "moon")).is_exceeded(np.array([[0.0]])).any()
    )


def test_a_reading_is_flagged_if_one_of_its_channels_cannot_be():
    info = StreamInfo("t", "temperature", "K", (2,), channels=("T1", "T2"))
    good, bad = (Reading("t", 0, 0, (one, 293.0)) for one in (294.0, -7725.85))
    assert flag_implausible(good, bounds_of(info)) is good
    found = flag_implausible(bad, bounds_of(info))
    assert found.quality == Quality.IMPLAUSIBLE
    assert found.values == bad.values
    frame = Frame("camera", 0, 0, np.zeros((2, 2), np.uint16), np.zeros((0, 0), np.uint16))
    assert flag_implausible(frame, bounds_of(STREAMS["camera"])) is frame


def test_what_cannot_be_is_counted_by_channel_and_the_first_named():
    info = StreamInfo("logger", "temperature", "K", (2,), channels=("air", "bed"))
    values = np.array([[290.0, 300.0], [290.0, -7725.85], [9.9e37, 8272.15]])
    bounds = bounds_of(info)
    air, bed = (
        excess.words(f"row {excess.first}")
        for excess in excesses(labels_of(info), bounds, values, bounds.is_exceeded(values))
    )
    assert re.fullmatch(r"logger air: 1 .* 9\.9e\+37 K at row 2; .*183\.9 to 350", air)
    assert re.fullmatch(r"logger bed: 2 .* -7725\.85 K at row 1; .*175 to 440", bed)


def test_values_for_a_result_are_without_unusable_and_impossible_ones():
    info = StreamInfo("t", "temperature", "K", (2,), channels=("T1", "T2"))
    values = np.array([[300.0, 0.0], [300.0, 301.0]])
    flags = np.array([int(Quality.IMPLAUSIBLE), int(Quality.BAD_CRC)])
    usable = bounds_of(info).usable(values, flags)
    assert np.isnan(usable).tolist() == [[False, True], [True, True]]
