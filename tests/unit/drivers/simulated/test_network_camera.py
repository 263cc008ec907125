import numpy as np
import pytest

from fieldkit.drivers import registry
from fieldkit.drivers.simulated import SimulatedField
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import Quality
from fieldkit.simulation import sand_slopes
from fieldkit.simulation.simulated_clock import SimulatedClock


@pytest.fixture(scope="module")
def opened():
    """The tCam and the board with the same Lepton, each in a field of its own from the same seed."""
    scene, streams = sand_slopes(duration_s=60.0), {}
    for driver in ("tcam", "purethermal"):
        with SimulatedClock(scene.start_ns) as clock, SimulatedField(scene, clock) as field:
            device = registry.open_device(field.plug(DeviceSettings("camera", driver, "simulated")), clock)
            frames = [device.read(1.0) for _ in range(3)]
            assert device.run_shutter()
            streams[driver] = device.info, frames, device.read(1.0)
    return streams


def test_a_tcam_shows_what_a_board_with_the_same_lepton_shows(opened):
    (info, frames, _), (_, expected, _) = opened["tcam"], opened["purethermal"]
    assert (info.unit, info.scale, info.model, info.device_time_unit) == ("K", 0.01, "tCam", "ms")
    for one, other in zip(frames, expected, strict=True):
        assert np.array_equal(one.counts, other.counts)
        assert (one.device_time, one.device_seq) == (other.device_time, other.device_seq)


def test_its_shutter_runs_and_is_flagged(opened):
    assert Quality.SHUTTER in opened["tcam"][2].quality
