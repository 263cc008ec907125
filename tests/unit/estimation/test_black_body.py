"""A can of water with a probe beside the beds: what the camera errs in all regions is taken out."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_worlds import CLEAR, drawn_world
from fieldkit.config import mistakes_in
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.region_temperatures import camera_error_k, remove_offsets
from fieldkit.model.site import Region, RegionKind

MINUTES = 15
CAN = Region("can", RegionKind.BLACKBODY, ((0.0, 0.0),), emissivity=0.96)


@pytest.fixture(scope="module")
def world():
    """Clear noon, and the same by a camera in the sun: 2 K within a quarter of an hour, a can at 20 °C."""
    world = drawn_world(3, CLEAR, minutes=MINUTES)
    error_k = 2.0 * np.sin(np.linspace(0.0, 4.0, MINUTES))
    kelvin = np.column_stack([world.history.temperature_k, np.full(MINUTES, 293.15)])
    probe_k = np.full_like(kelvin, np.nan)
    probe_k[:, -1] = 293.15
    flags = np.zeros(kelvin.shape, np.int64)
    history = replace(
        world.history,
        temperature_k=kelvin + error_k[:, np.newaxis],
        probe_k=probe_k,
        region_flags=flags,
    )
    return world, replace(world, history=history, regions=(*world.regions, CAN)), error_k


def test_the_cameras_error_is_that_of_the_black_body(world):
    _, in_the_sun, error_k = world
    assert camera_error_k(in_the_sun.history, in_the_sun.regions) == pytest.approx(error_k, abs=1e-9)
    probe_k = in_the_sun.history.probe_k.copy()
    probe_k[[0, 5]] = np.nan  # not read yet, and not read for a minute
    gaps = camera_error_k(replace(in_the_sun.history, probe_k=probe_k), in_the_sun.regions)
    assert np.isnan(gaps[0])
    assert gaps[4:7] == pytest.approx(error_k[[4, 4, 6]], abs=1e-9)


@pytest.mark.parametrize("model", ["full", "learned"])
def test_slopes_are_those_of_a_camera_without_that_error(world, model):
    alone, in_the_sun, _ = world
    settings = replace(alone.settings, model=model)
    expected = SlopeChain(alone.regions, settings).at_once(alone.history).slopes
    slopes = SlopeChain(in_the_sun.regions, settings).at_once(in_the_sun.history).slopes
    assert [slope.region for slope in slopes] == ["bed0", "bed1", "bed2"]
    for name in ("tilt_deg", "tilt_low_deg", "tilt_high_deg"):
        numbers = [[getattr(slope, name) for slope in each] for each in (slopes, expected)]
        assert numbers[0] == pytest.approx(numbers[1], abs=1e-4)


def test_without_black_bodies_no_bit_changes(world):
    alone, *_ = world
    corrected = remove_offsets(alone.history, alone.regions, alone.settings)
    assert corrected.temperature_k.tobytes() == alone.history.temperature_k.tobytes()


def test_a_black_body_needs_its_probe_and_emissivity(tmp_path):
    text = (
        "[site]\nlatitude_deg = 1.0\nlongitude_deg = 1.0\n"
        '[[region]]\nname = "flat"\nkind = "reference"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'
        '[[region]]\nname = "can"\nkind = "blackbody"\npoints_px = [[0, 0], [9, 0], [9, 9]]\n'
    )
    (mistake,) = mistakes_in(text, tmp_path / "fieldkit.toml")
    assert mistake[1].path == ("region", 1, "kind")
    assert not mistakes_in(f'{text}emissivity = 0.96\nprobes = ["thermometer:T1"]\n', tmp_path / "f.toml")
