"""What looks at what on an emissivity day, and what is kept of its samples: kelvin worked out by hand."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fieldkit.calibrate.measurement import (
    NOT_MEASURED_K,
    MeasurementOptions,
    MeasurementSetup,
    ReadingCollector,
    band_of,
    measurement_setup,
    reflected_source,
)
from fieldkit.calibration.band import FLAT, CameraBand, ResponseBand
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Quality, Reading
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.radiance import band_radiance, band_temperature, brightness_temperature_k
from tests.harness.next_steps import at, steps

CAMERA = StreamInfo("camera", "brightness_temperature", "K", (6, 9), scale=0.01)
PROBES = StreamInfo("thermometer", "temperature", "K", (3,), channels=("sand", "tape", "air"))
REGIONS = tuple(
    Region(name, kind, ((x, 1.0), (x + 2.0, 1.0), (x + 2.0, 4.0), (x, 4.0)))
    for name, kind, x in (
        ("sand", RegionKind.REFERENCE, 0.0),
        ("foil", RegionKind.TARGET, 3.0),
        ("tape", RegionKind.TARGET, 6.0),
    )
)
WHERE = Path("fieldkit.toml")
GRAIN = np.arange(12) - 5.5
"""Counts by which the pixels of a region differ: a foil without any is saturated."""


def made(*streams: StreamInfo, probes: dict[str, list[str]] | None = None, **given: Any) -> MeasurementSetup:
    options = MeasurementOptions(**{"foil_emissivity": 0.0, **given})
    return measurement_setup(WHERE, streams or (CAMERA, PROBES), REGIONS, probes or {}, options)


def frame(second: int, quality: Quality = Quality.GOOD, **kelvin: float) -> Frame:
    counts = np.full((6, 9), 29_000, np.uint16)
    for region in REGIONS:
        counts[region.mask((6, 9))] = np.round(100 * kelvin.get(region.name, 290.0) + GRAIN)
    none = np.zeros((0, 9), np.uint16)
    return Frame("camera", second * 10**9, second * 10**9, counts, none, quality)


def reading(second: int, *kelvin: float, quality: Quality = Quality.GOOD) -> Reading:
    return Reading("thermometer", second * 10**9, second * 10**9, kelvin, quality=quality)


def collected(setup: MeasurementSetup, **kelvin: float) -> ReadingCollector:
    collector = ReadingCollector(setup)
    for second in range(3):
        collector.add(frame(second, **kelvin))
        collector.add(reading(second, 310.0, 311.0, 295.0))
    return collector


def test_camera_foil_and_probe_are_kept_as_they_were_measured():
    collector = collected(made(), sand=305.0, foil=240.0)
    found = collector.readings()
    assert found.apparent_k == pytest.approx([305.0] * 3)
    assert found.reflected_k == pytest.approx([240.0] * 3)
    assert found.contact_k == pytest.approx([310.0] * 3)
    assert found.camera_ns.tolist() == found.contact_ns.tolist() == [0, 10**9, 2 * 10**9]
    assert set(collector.other_probes_k()) == {"tape", "air"}
    assert collector.other_probes_k()["air"] == pytest.approx([295.0] * 3)


def test_samples_that_are_not_usable_and_other_streams_are_left_out():
    collector = collected(made(), sand=305.0)
    collector.add(frame(9, Quality.SHUTTER, sand=400.0))
    collector.add(frame(9, Quality.BAD_CRC, sand=400.0))
    collector.add(reading(9, 400.0, 400.0, 400.0, quality=Quality.NO_VALUE))
    collector.add(frame(9, sand=400.0)._replace(stream="another"))
    collector.add(reading(9, 400.0, 400.0, 400.0)._replace(stream="another"))
    assert collector.readings().apparent_k == pytest.approx([305.0] * 3)
    assert collector.readings().contact_k == pytest.approx([310.0] * 3)


@pytest.mark.parametrize(
    ("channel", "kelvin"), [(None, 310.0), ("tape", 311.0), ("2", 311.0), ("3", 295.0), (3, 295.0)]
)
def test_a_probe_is_chosen_by_its_name_or_its_number_on_the_meter(channel, kelvin):
    assert collected(made(channel=channel)).readings().contact_k == pytest.approx([kelvin] * 3)


def test_a_thermometer_that_showed_fahrenheit_is_read_as_such():
    """100 °F are 310.928 K; taken for °C they were stored as 373.15 K."""
    collector = ReadingCollector(made(unit="F"))
    collector.add(frame(0))
    collector.add(reading(0, 373.15, 373.15, 373.15))
    assert collector.readings().contact_k == pytest.approx([310.928], abs=1e-3)


def test_an_emissivity_that_the_camera_applied_is_undone():
    """What it reported of a grey surface, by its own law, becomes what it saw."""
    seen = float(brightness_temperature_k(320.0, 0.9, 280.0))
    setup = made(camera_emissivity=0.9, camera_reflected_c=280.0 - 273.15)
    assert collected(setup, sand=320.0).readings().apparent_k == pytest.approx([seen] * 3, abs=0.01)
    told = replace(CAMERA, settings={"emissivity": 0.9})
    assert made(told, PROBES).camera_emissivity == 0.9
    assert made(told, PROBES, camera_emissivity=0.9).camera_emissivity == 0.9
    with pytest.raises(ConfigError, match=r"0\.9", check=at(Argument("camera_emissivity", 0.8))) as refused:
        made(told, PROBES, camera_emissivity=0.8)
    assert Argument("camera_emissivity") in steps(refused.value)


def test_the_air_in_between_is_taken_out():
    """Fifty metres of warm air in front of cold foil and hot sand: both are farther from the air."""
    near, far = (
        collected(made(distance_m=d, air_c=20.0), sand=320.0, foil=240.0).readings() for d in (0.0, 50.0)
    )
    assert far.apparent_k[0] > near.apparent_k[0] + 0.3
    assert far.reflected_k[0] < near.reflected_k[0] - 0.3
    wet = collected(made(distance_m=50.0, air_c=20.0, humidity_percent=95.0), sand=320.0).readings()
    assert 0.1 < wet.apparent_k[0] - far.apparent_k[0] < 2.0


def test_tape_stands_in_for_a_thermometer():
    emissivity, sky_k, true_k = 0.95, 240.0, 315.0
    seen = float(
        band_temperature(emissivity * band_radiance(true_k) + (1.0 - emissivity) * band_radiance(sky_k))
    )
    setup = made(CAMERA, tape="tape", tape_emissivity=emissivity)
    assert setup.thermometer is None
    found = collected(setup, sand=305.0, foil=sky_k, tape=seen).readings()
    assert found.contact_k == pytest.approx([true_k] * 3, abs=0.02)
    assert collected(setup).other_probes_k() == {}


@pytest.mark.parametrize(
    ("reflected", "kelvin"), [("-40", 233.15), ("free", NOT_MEASURED_K), ("12.5", 285.65)]
)
def test_a_reflected_temperature_may_be_given_or_left_to_the_fit(reflected, kelvin):
    setup = made(reflected=reflected)
    assert (setup.foil, setup.reflected_k) == (None, pytest.approx(kelvin))
    assert collected(setup).readings().reflected_k == pytest.approx([kelvin] * 3)


def test_the_foil_is_the_region_of_that_kind_or_else_of_that_name():
    outline = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))
    named, laid = Region("foil", RegionKind.TARGET, outline), Region("mirror", RegionKind.FOIL, outline)
    assert reflected_source("foil", [named], Path())[0] is named
    assert reflected_source("foil", [named, laid], Path())[0] is laid


def test_nothing_usable_is_said_so():
    with pytest.raises(CalibrationError, match="frames"):
        ReadingCollector(made()).readings()
    collector = ReadingCollector(made())
    collector.add(frame(0))
    with pytest.raises(CalibrationError, match=r"(?s)thermometer.*fieldkit\.check\(session\)"):
        collector.readings()


@pytest.mark.parametrize(
    ("streams", "given", "said"),
    [
        ((PROBES,), {}, "no camera"),
        ((CAMERA,), {}, "thermometer"),
        ((CAMERA, PROBES, replace(PROBES, name="second")), {}, "thermometer"),
        ((), {"region": "gravel"}, "'gravel'"),
        ((), {"reflected": "mirror"}, "'mirror'"),
        ((), {"band": "1,2,3"}, "band='1,2,3'"),
        *(((), {"channel": one}, f"no probe '{one}'") for one in ("0", "4", "sky", "\u00b2")),
        *(((), {"reflected": one}, "reflected temperature") for one in ("nan", math.inf, "-400", -273.15)),
        # sand that is its own tape of 0.95 has an emissivity of 0.950, whatever it is
        *(((), one, "sample, foil") for one in ({"tape": "sand"}, {"reflected": "sand"}, {"tape": "foil"})),
    ],
)
def test_what_cannot_be_set_up_is_refused(streams, given, said):
    with pytest.raises(ConfigError, match=said):
        made(*streams, **given)


def test_bands_as_they_are_typed(tmp_path):
    table = tmp_path / "response.csv"
    table.write_text("um,response\n8,1\n14,1\n", encoding="utf-8")
    assert band_of("8-14") is FLAT
    assert band_of("1428,1.0") == CameraBand(1428.0, 1.0)
    assert band_of("16556,1428,1.0,-342") == CameraBand(b=1428.0, f=1.0, r=16556.0, o=-342.0)
    assert isinstance(band_of(str(table)), ResponseBand)


@pytest.mark.parametrize(
    "given",
    [
        {"camera_sd_k": -0.1},
        {"probe_sd_k": math.nan},
        {"reflected_sd_k": math.inf},
        {"tape_emissivity": 1.01},
        {"tape_sd": 0.0},  # the fit would take the tape for a thermometer
        {"foil_emissivity": 1.0},
        {"camera_emissivity": 0.0},
        {"camera_reflected_c": -273.15},
        {"air_c": -400.0},
        {"distance_m": -1.0},
        {"humidity_percent": 101.0},
        {"angle_deg": 91.0},
        {"temperatures": 0},
        {"unit": "K"},
    ],
)
def test_a_number_that_cannot_be_is_refused_in_python_as_on_the_command_line(given):
    with pytest.raises(ConfigError) as refused:
        MeasurementOptions(**given)
    assert refused.value.place
    assert refused.value.fix


@pytest.mark.parametrize("band", ["-5,1", "nan,1", "0,1", "-1,1428,1,0", "1428,inf", "1,2,3"])
def test_constants_that_no_camera_has_are_refused(band):
    with pytest.raises(ConfigError, check=at(Argument("band", band))):
        band_of(band)


def test_a_response_that_is_not_there_is_not_taken_for_a_damaged_session():
    with pytest.raises(ConfigError, match=r"nofile\.csv"):
        band_of("nofile.csv")


IN_REGIONS = {"sand": ["thermometer:sand"], "tape": ["thermometer:tape"]}


@pytest.mark.parametrize(("region", "probe"), [("sand", "sand"), ("tape", "tape")])
def test_a_regions_own_probe_is_chosen(region, probe):
    """The first one gave a bed of 5 degrees 0.957 ± 0.035 for 0.90, by the probe of the bed beside it."""
    setup = made(probes=IN_REGIONS, region=region)
    assert (setup.probe_name, setup.remarks) == (probe, ())


def test_of_several_thermometers_the_one_with_the_regions_probe_is_chosen():
    other = replace(PROBES, name="logger")
    setup = made(CAMERA, PROBES, other, probes={"sand": ["logger:air"]})
    assert setup.thermometer == other
    assert setup.probe_name == "air"


def test_a_region_without_a_probe_is_not_given_that_of_another():
    with pytest.raises(ConfigError, check=at("foil", Argument("channel"))):
        made(probes=IN_REGIONS, region="foil", reflected=-40.0)


def test_a_probe_of_another_region_is_noted():
    setup = made(probes=IN_REGIONS, channel="tape")
    (remark,) = setup.remarks
    assert "tape" in remark
    assert "sand" in remark
