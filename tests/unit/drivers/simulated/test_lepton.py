import numpy as np
import pytest

from fieldkit.drivers import registry
from fieldkit.drivers.cameras.purethermal import decode
from fieldkit.drivers.simulated import SimulatedField
from fieldkit.drivers.simulated.lepton import PERIOD_NS, SimulatedLepton
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceError, DeviceLostError
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.samples import Quality
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation import Fault, sand_slopes
from fieldkit.simulation.simulated_clock import SimulatedClock

CAMERA = DeviceSettings("camera", "purethermal", "simulated")
RUN_FFC, FFC_MODE, RESOLUTION = (6, 17), (6, 16), (0x15, 19)


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


def test_driver_learns_scale_and_identity_from_the_board(camera):
    info = camera.info
    assert (info.shape, info.metadata_shape, info.scale, info.unit) == ((120, 160), (2, 160), 0.01, "K")
    assert info.model == "500-0771-01"
    assert info.serial_number
    assert info.settings["gain"] == "high"


def test_frames_come_at_the_rate_of_the_sensor_each_different(camera):
    frames = [camera.read(1.0) for _ in range(30)]
    assert set(np.diff([frame.mono_ns for frame in frames])) == {PERIOD_NS}
    assert all(frame.quality == Quality.GOOD for frame in frames)
    assert set(np.diff([frame.device_seq for frame in frames])) == {3}, (
        "the sensor counts at three times the rate"
    )


def test_uptime_is_the_clock_of_the_camera_and_a_little_fast(camera, clock):
    first = camera.read(1.0)
    clock.sleep(1000.0)
    camera.skip_until(clock.mono_ns())
    last = camera.read(1.0)
    elapsed_ms = (last.mono_ns - first.mono_ns) / 1e6
    assert (last.device_time - first.device_time) / elapsed_ms - 1 == pytest.approx(20e-6, abs=2e-6)


def test_nothing_within_the_timeout_is_none(source):
    assert source.read(0.01) is None
    assert source.read(1.0) is not None


def test_slow_reader_loses_frames_and_is_told(camera, clock):
    camera.read(1.0)
    clock.sleep(2.0)
    frame = camera.read(1.0)
    assert Quality.DROPPED_BEFORE in frame.quality
    assert clock.mono_ns() - frame.mono_ns < SECOND_NS, "only what the kernel's buffers hold is old"


def test_skipped_frames_are_not_lost_ones(camera, clock):
    camera.read(1.0)
    until_ns = clock.mono_ns() + 60 * SECOND_NS
    camera.skip_until(until_ns)
    frame = camera.read(1.0)
    assert until_ns <= frame.mono_ns < until_ns + PERIOD_NS
    assert frame.quality == Quality.GOOD


def test_same_scene_gives_the_same_bytes(scene):
    def bytes_of_a_minute():
        with SimulatedClock(scene.start_ns) as clock:
            source = SimulatedLepton(scene, clock)
            for at_s in (0, 20, 40):
                source.skip_until(clock.to_mono_ns(scene.start_ns) + at_s * SECOND_NS)
                yield source.read(1.0)

    assert list(bytes_of_a_minute()) == list(bytes_of_a_minute())


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
        told = Quality.SHUTTER in telemetry_quality(frame)
        since_s = (frame.mono_ns - began_ns) / SECOND_NS
        assert told == (0.045 <= since_s < 10.845), since_s


def telemetry_quality(frame):
    told = decode(frame.counts.tobytes() + frame.metadata_rows.tobytes())
    return Quality.SHUTTER if told.shutter else Quality.GOOD


def test_camera_corrects_itself_every_three_minutes_unless_told_not_to(source, clock):
    def corrected_ms(after_s):
        source.skip_until(clock.mono_ns() + after_s * SECOND_NS)
        return int.from_bytes(source.read(1.0).data[-640:][60:64], "little")

    times = sorted({corrected_ms(30) for _ in range(20)})
    assert np.diff(times) == pytest.approx(180_000, abs=10)
    mode = bytearray(source.get_control(*FFC_MODE, 32))
    mode[0] = 0  # manual
    source.set_control(*FFC_MODE, bytes(mode))
    assert len({corrected_ms(30) for _ in range(10)}) == 1


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


# --- controls


def test_controls_answer_as_the_board_does(source):
    assert source.get_control(4, 8, 32).startswith(b"500-0771-01\0")
    assert int.from_bytes(source.get_control(6, 4, 4), "little") > 600_000, "uptime in ms"
    assert 23_000 < int.from_bytes(source.get_control(6, 6, 2), "little") < 35_000, "FPA in K x 100"
    assert int.from_bytes(source.get_control(6, 20, 4), "little") == 3, "correction done"
    source.set_control(*RUN_FFC, b"\x01")
    assert int.from_bytes(source.get_control(6, 20, 4), "little") == 2, "correction runs"
    assert int.from_bytes(source.get_control(6, 18, 4), "little") == 1, "busy"


def test_coarser_resolution_changes_counts_and_telemetry_together(source):
    fine = decode(source.read(1.0).data)
    source.set_control(*RESOLUTION, bytes(4))
    coarse = decode(source.read(1.0).data)
    assert (fine.scale, coarse.scale) == (0.01, 0.1)
    assert coarse.counts.mean() * 0.1 == pytest.approx(fine.counts.mean() * 0.01, abs=0.1)


@pytest.mark.parametrize("control", [(6, 99, 4), (6, 4, 2), (3, 1, 4)])
def test_what_the_board_does_not_have_is_an_error(source, control):
    with pytest.raises(DeviceError):
        source.get_control(*control)
    unit, selector, length = control
    with pytest.raises(DeviceError):
        source.set_control(unit, selector, bytes(length))


def test_what_is_not_simulated_cannot_be_changed(source):
    with pytest.raises(DeviceError, match="keeps control"):
        source.set_control(6, 19, (1).to_bytes(4, "little"))
    source.set_control(6, 19, bytes(4))  # high gain is what it has


# --- faults


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
        levels = {"before": [], "during": [], "after": []}
        shutter = 0
        for frame in read_until(camera, clock, 60.0, scene):
            since_s = (frame.time_ns - scene.start_ns) / SECOND_NS - camera.info.latency_s
            when = (
                "before"
                if since_s < 20
                else "during"
                if 21 < since_s < 40
                else "after"
                if since_s > 41
                else ""
            )
            if when:
                levels[when].append(frame.counts[mask].mean() / 100)
            shutter += Quality.SHUTTER in frame.quality
    before, during, after = (np.mean(levels[when]) for when in ("before", "during", "after"))
    assert during - before == pytest.approx(0.8, abs=0.3)
    assert after - before == pytest.approx(0.0, abs=0.3)
    assert shutter > 150, "two corrections of ten seconds and more"
