import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.physics.camera_laws import (
    LAWS,
    Planck,
    frame_k,
    frames_k,
    has_temperatures,
    ht301,
    ht301_fpa_c,
    ht301_parameters,
    law_named,
    linear,
    planck_table,
)

E60 = Planck(r1=16528.178, b=1427.5, f=1.0, o=-1307.0, r2=0.012258549)
"""Constants printed in a public program for a FLIR One."""


def test_linear_law_is_scale_and_offset():
    counts = np.array([[0, 29515, 65535]], np.uint16)
    assert linear(counts, 0.01)[0] == pytest.approx([0.0, 295.15, 655.35], abs=3e-5)
    assert linear(counts, 0.04, 10.0)[0] == pytest.approx([10.0, 1190.6, 2631.4], abs=3e-4)
    assert linear(counts, 0.01).dtype == np.float32


def stream(law: str, scale: float = 1.0, settings: dict | None = None, rows: tuple[int, int] = (0, 0)):
    """A camera's declaration."""
    quantity = "brightness_temperature"
    return StreamInfo("cam", quantity, "K", (4, 256), scale, 5.0, law, rows, settings=settings or {})


def test_counts_of_a_stream_become_kelvin_by_its_declaration():
    counts = np.array([[20_000, 30_000], [0, 65535]], np.uint16)
    linear_k = frame_k(stream("linear", 0.01), counts, counts[:0])
    assert linear_k == pytest.approx(counts * 0.01 + 5.0, abs=1e-12)
    assert frame_k(stream("linear", 0.01), counts, counts[:0], np.float32).dtype == np.float32
    planck_k = frames_k(stream("planck", settings=asdict(E60)), np.array([counts]), counts[:0])
    assert np.array_equal(planck_k[0], planck_table(E60).astype(np.float64)[counts], equal_nan=True)


@pytest.mark.parametrize(
    ("law", "scale"), [("linear", np.nan), ("cubic", 1.0), ("planck", 1.0), ("ht301", 1.0)]
)
def test_without_a_known_scale_there_are_no_kelvin(law, scale):
    counts = np.full((2, 4, 256), 5000, np.uint16)
    info = stream(law, scale)
    assert has_temperatures(info) == (law in LAWS)
    assert np.isnan(frames_k(info, counts, np.empty((2, 0, 256), np.uint16))).all()


@pytest.mark.parametrize("wrong", [{"b": 1e9}, {"b": 0.0}, {"r2": 0.0}, {"air_k": 0.0}, {"distance_m": -1.0}])
def test_impossible_constants_of_a_law_give_no_kelvin_and_no_error(wrong):
    constants = asdict(E60) | wrong
    counts = np.full((4, 256), 20_000, np.uint16)
    assert np.isnan(frame_k(stream("planck", settings=constants), counts, counts[:0])).all()


def test_a_law_without_its_constants_gives_no_kelvin(monkeypatch):
    gain = {"gain": lambda counts, rows, settings: (counts * settings["gain"]).astype(np.float32)}
    monkeypatch.setattr("fieldkit.physics.camera_laws.LAWS", gain)
    counts = np.full((4, 256), 20_000, np.uint16)
    assert np.isnan(frame_k(stream("gain"), counts, counts[:0])).all()
    assert frame_k(stream("gain", settings={"gain": 0.01}), counts, counts[:0]) == pytest.approx(200.0)


def test_unknown_law_is_named():
    with pytest.raises(ValueError, match="'cubic'"):
        law_named("cubic")
    assert set(LAWS) == {"ht301", "planck"}


@pytest.mark.parametrize(
    ("width", "raw", "celsius"), [(640, 6867, 20.0), (384, 7620, 25.0), (256, 8617, 20.0)]
)
def test_sensor_temperature_of_the_ht301_family(width, raw, celsius):
    assert ht301_fpa_c(width, raw) == pytest.approx(celsius)


@pytest.mark.parametrize("shape", [(4, 160), (3, 384), (0, 0)])
def test_rows_of_another_camera_are_refused(shape):
    with pytest.raises(ValueError, match="HT-301"):
        ht301_parameters(np.zeros(shape, np.uint16))


def raw2temp(raw, e, od, refl_k, air_k, window_k, window, humidity, law):
    """`raw2temp` of the R package Thermimage (G. Tattersall), transcribed; °C of a count."""
    air_c = air_k - 273.15
    h2o = humidity * math.exp(1.5587 + 0.06939 * air_c - 0.00027816 * air_c**2 + 0.00000068455 * air_c**3)
    tau1 = tau2 = 1.9 * math.exp(-math.sqrt(od / 2) * (0.006569 - 0.002276 * math.sqrt(h2o))) + (
        1 - 1.9
    ) * math.exp(-math.sqrt(od / 2) * (0.01262 - 0.00667 * math.sqrt(h2o)))

    def counts(kelvin):
        return law.r1 / (law.r2 * (math.exp(law.b / kelvin) - law.f)) - law.o

    atm1 = (1 - tau1) / e / tau1 * counts(air_k)
    atm2 = (1 - tau2) / e / tau1 / window / tau2 * counts(air_k)
    wind = (1 - window) / e / tau1 / window * counts(window_k)
    refl = (1 - e) / e * counts(refl_k)
    obj = raw / e / tau1 / window / tau2 - atm1 - atm2 - wind - refl
    return law.b / math.log(law.r1 / (law.r2 * (obj + law.o)) + law.f) - 273.15


@pytest.mark.parametrize("count", [16_000, 20_000, 30_000])
def test_flir_law_through_air_and_a_window_is_thermimages(count):
    law = Planck(r1=21106.77, b=1501.0, f=1.0, o=-7340.0, r2=0.012545258)
    path = {"emissivity": 0.93, "distance_m": 40.0, "reflected_k": 268.0, "air_k": 303.0, "window_k": 290.0,
            "window_transmission": 0.85, "humidity": 0.8}  # fmt: skip
    found = planck_table(replace(law, **path))[count] - 273.15
    expected = raw2temp(count, 0.93, 40.0, 268.0, 303.0, 290.0, 0.85, 0.8, law)
    assert found == pytest.approx(expected, abs=1e-3)


def ht301_rows(shutter_c, fpa_raw, constants=(0.01, 8.0, 0.0, 0.0, 0.6)):
    """A picture's last rows: raw sensor word, then shutter in counts and tenths of kelvin, five constants."""
    rows = np.zeros((4, 384), np.uint16)
    words, area = rows.ravel(), 3 * 384
    words[1], words[area], words[area + 1] = fpa_raw, 3500, round(10 * (shutter_c + 273.15))
    words[area + 3 : area + 13] = np.array(constants, "<f4").view("<u2")
    return rows


def test_each_frame_of_the_ht301_has_its_own_scale():
    rows = np.array([ht301_rows(shutter_c, 7620) for shutter_c in (20.0, 21.0)])
    counts = np.full((2, 1, 384), 3500, np.uint16)
    first, second = frames_k(stream("ht301", rows=(4, 384)), counts, rows)
    assert second == pytest.approx(ht301(counts[1], rows[1], {}), abs=0)
    assert (second - first).mean() == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("fpa_raw", [7620, 6500, 5000])  # sensor at 25, 56.1 and 97.8 °C
@pytest.mark.parametrize("count", [4000, 6000])
def test_ht301_law_by_the_published_formula(fpa_raw, count):
    constants = (0.0002, 0.02, 0.000002, -0.00001, 0.0125)
    found = ht301(np.full((1, 1), count, np.uint16), ht301_rows(29.6, fpa_raw, constants), {})[0, 0]
    c1, c2, c3, c4, c5 = (float(np.float32(one)) for one in constants)
    t_fpa, t_shutter = 20.0 - (fpa_raw - 7800.0) / 36.0, round(10 * (29.6 + 273.15)) / 10 - 273.15
    off = 3500 - max(0, int(390.0 - 7.05 * t_fpa))  # the maker's library: the correction ends at nothing
    p = c2 / (2.0 * c1)
    s = c1 * t_shutter**2 + c2 * t_shutter
    g = c3 * t_fpa**2 + c4 * t_fpa + c5
    assert found - 273.15 == pytest.approx(math.sqrt(((count - off) * g + s) / c1 + p * p) - p, abs=2e-3)
