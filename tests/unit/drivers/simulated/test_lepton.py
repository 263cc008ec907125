import numpy as np
import pytest

from fieldkit.drivers import registry
from fieldkit.drivers.cameras.purethermal import decode
from fieldkit.drivers.simulated import SimulatedField
from fieldkit.drivers.simulated.lepton import PERIOD_NS, SimulatedLepton
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceLostError
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.samples import Quality
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation import Fault, sand_slopes
from fieldkit.simulation.simulated_clock import SimulatedClock

CAMERA = DeviceSettings("camera", "purethermal", "simulated")
RUN_FFC = (6, 17)


@pytest.fixture(scope="module")
def scene():
    return sand_slopes(duration_s=1200.0)


@pytest.fixture
def clock(scene):
    with SimulatedClock(scene.start_ns) as clock:
        yield clock


@pytest.fixture
def source(scene, clock):
    return SimulatedLepton(scene, clock)


@pytest.fixture
def camera(scene, clock):
    with SimulatedField(scene, clock) as field:
        yield registry.open_device(field.plug(CAMERA), clock)


def camera_of(scene, clock):
    return registry.open_device(SimulatedField(scene, clock).plug(CAMERA), clock)


def read_until(camera, clock, after_s, scene):
    """Frames until so many seconds after the scene's start."""
    end_ns = clock.to_mono_ns(scene.start_ns) + round(after_s * SECOND_NS)
    while clock.mono_ns() < end_ns:
        if (frame := camera.read(0.5)) is not None:
            yield frame


# --- frames


def test_regions_show_the_brightness_of_their_beds(camera, scene):
    """Within the camera's own errors: level and shading of about 0.1 K each."""
    frame = camera.read(1.0)
    seen_ns = frame.time_ns - round(camera.info.latency_s * SECOND_NS)
    for region, expected_k in zip(scene.regions, scene.at(seen_ns).brightness_k, strict=False):
        mean_k = frame.counts[region.mask(frame.counts.shape)].mean() * camera.info.scale
        assert mean_k == pytest.approx(expected_k, abs=0.5)


def test_frames_come_at_the_rate_of_the_sensor_each_different(camera):
    frames = [camera.read(1.0) for _ in range(30)]
    assert set(np.diff([frame.mono_ns for frame in frames])) == {PERIOD_NS}
    assert all(frame.quality == Quality.GOOD for frame in frames)
    counted = set(np.diff([frame.device_seq for frame in frames]))
    assert counted == {3}, "the sensor counts at three times the rate"


def test_slow_reader_loses_frames_and_is_told(camera, clock):
    camera.read(1.0)
    clock.sleep(2.0)
    frame = camera.read(1.0)
    assert Quality.DROPPED_BEFORE in frame.quality
    assert clock.mono_ns() - frame.mono_ns < SECOND_NS, "only what the kernel's buffers hold is old"


# --- shutter


def test_correction_freezes_the_frame_and_is_told_for_ten_seconds(camera, clock):
    camera.read(1.0)
    assert camera.run_shutter()
    began_ns = clock.mono_ns()
    frames = []
    while clock.mono_ns() < began_ns + 13 * SECOND_NS:
        frames.append(camera.read(1.0))
    frozen = [frame for frame in frames if Quality.DUPLICATE in frame.quality]
    assert 5 <= len(frozen) <= 8, "0.8 s at 8.7 Hz"
    for frame in frames:
        told = decode(frame.counts.tobytes() + frame.metadata_rows.tobytes()).shutter
        since_s = (frame.mono_ns - began_ns) / SECOND_NS
        assert told == (0.045 <= since_s < 10.845), since_s


def test_camera_corrects_itself_every_three_minutes(source, clock):
    def corrected_ms(after_s):
        source.skip_until(clock.mono_ns() + after_s * SECOND_NS)
        return int.from_bytes(source.read(1.0).data[-640:][60:64], "little")

    times = sorted({corrected_ms(30) for _ in range(20)})
    assert np.diff(times) == pytest.approx(180_000, abs=10)


def test_correction_changes_the_level_of_the_whole_frame(source, clock, scene):
    def level():
        kelvin = decode(source.read(1.0).data).counts.astype(float) / 100
        seen_ns = clock.to_utc_ns(clock.mono_ns())
        truth = scene.at(seen_ns).brightness_k
        masks = [region.mask(kelvin.shape) for region in scene.regions]
        return np.array([kelvin[mask].mean() - k for mask, k in zip(masks, truth, strict=False)])

    changes = []
    for _ in range(6):
        before = level()
        source.set_control(*RUN_FFC, b"\x01")
        source.skip_until(clock.mono_ns() + 2 * SECOND_NS)
        changes.append(level() - before)
    changes = np.array(changes)
    assert np.abs(changes).max() > 0.05, "levels do jump"
    assert np.ptp(changes, axis=1).max() < 0.02, "and alike in all beds"


def test_pulled_cable_is_a_lost_device_until_it_is_back():
    scene = sand_slopes(duration_s=60.0, faults=(Fault(FaultKind.CABLE, 20.0, 10.0),))
    with SimulatedClock(scene.start_ns) as clock:
        settings = SimulatedField(scene, clock).plug(CAMERA)
        camera = registry.open_device(settings, clock)
        with pytest.raises(DeviceLostError):
            list(read_until(camera, clock, 60.0, scene))
        assert 20.0 <= (clock.to_utc_ns(clock.mono_ns()) - scene.start_ns) / SECOND_NS < 20.3
        camera.close()
        with pytest.raises(DeviceLostError):
            registry.open_device(settings, clock)
        clock.sleep(10.0)
        assert registry.open_device(settings, clock).read(1.0) is not None


# --- faults


def test_frozen_camera_sends_one_frame_again_and_again():
    scene = sand_slopes(duration_s=60.0, faults=(Fault(FaultKind.FROZEN, 10.0, 20.0),))
    with SimulatedClock(scene.start_ns) as clock:
        camera = camera_of(scene, clock)
        frames = list(read_until(camera, clock, 40.0, scene))
    begin_ns, end_ns = scene.fault_spans(FaultKind.FROZEN)[0]
    latency_ns = round(camera.info.latency_s * SECOND_NS)
    during = [frame for frame in frames if begin_ns <= frame.time_ns - latency_ns < end_ns]
    assert len({frame.counts.tobytes() for frame in during}) == 1
    assert len({frame.device_time for frame in during}) == 1
    assert any(Quality.FROZEN in frame.quality for frame in during)
    after = [frame for frame in frames if frame.time_ns - latency_ns >= end_ns]
    assert not any(Quality.FROZEN in frame.quality for frame in after)
    assert len({frame.device_time for frame in after}) == len(after)


def test_faulty_shutter_puts_the_level_wrong_until_it_runs_again():
    scene = sand_slopes(duration_s=60.0, faults=(Fault(FaultKind.SHUTTER, 20.0, 20.0),))
    mask = scene.regions[0].mask((120, 160))
    with SimulatedClock(scene.start_ns) as clock:
        camera = camera_of(scene, clock)
        spans = {"before": (0, 20), "during": (21, 40), "after": (41, 60)}
        levels, shutter = {name: [] for name in spans}, 0
        for frame in read_until(camera, clock, 60.0, scene):
            since_s = (frame.time_ns - scene.start_ns) / SECOND_NS - camera.info.latency_s
            for name, (begin_s, end_s) in spans.items():
                if begin_s < since_s < end_s:
                    levels[name].append(frame.counts[mask].mean() / 100)
            shutter += Quality.SHUTTER in frame.quality
    before, during, after = map(np.mean, levels.values())
    assert during - before == pytest.approx(0.8, abs=0.3)
    assert after - before == pytest.approx(0.0, abs=0.3)
    assert shutter > 150, "two corrections of ten seconds and more"
