import subprocess
import sys
import threading

import pytest

from fieldkit.drivers import registry
from fieldkit.drivers.simulated import SimulatedField
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation import Fault, sand_slopes
from fieldkit.simulation.simulated_clock import SimulatedClock


@pytest.fixture(scope="module")
def scene():
    return sand_slopes(
        duration_s=600.0, faults=(Fault(FaultKind.CLOCK, 60.0), Fault(FaultKind.DISK, 60.0, 100.0))
    )


@pytest.fixture
def clock(scene):
    with SimulatedClock(scene.start_ns) as clock:
        yield clock


def test_devices_on_real_ports_are_left_alone(scene, clock):
    settings = DeviceSettings("lux", "lutron", "/dev/ttyUSB0")
    with SimulatedField(scene, clock) as field:
        assert field.plug(settings) is settings


def test_driver_without_a_simulated_instrument_is_refused_with_those_that_have_one(scene, clock):
    with SimulatedField(scene, clock) as field, pytest.raises(ConfigError, match="flux-capacitor") as error:
        field.plug(DeviceSettings("x", "flux-capacitor", "simulated"))
    assert "lutron" in error.value.fix


def test_clock_fault_steps_the_system_clock_by_an_hour(scene, clock):
    with SimulatedField(scene, clock):
        anchor = clock.check().utc_minus_mono_ns
        clock.sleep(59.0)
        assert clock.check().utc_minus_mono_ns == anchor
        clock.sleep(2.0)
        assert clock.check().utc_minus_mono_ns == anchor + 3600 * SECOND_NS
        assert clock.to_utc_ns(clock.mono_ns()) == scene.start_ns + 61 * SECOND_NS


def test_disk_fault_takes_the_free_space_away_and_gives_it_back(scene, clock):
    real = 50_000_000_000
    with SimulatedField(scene, clock) as field:
        free = []
        for _ in range(10):
            free.append(field.disk_free_bytes(real))
            clock.sleep(20.0)
    assert free[0] == free[-1] == real
    assert min(free) < 64_000_000
    assert field.disk_free_bytes(1000) == 1000


INSTRUMENTS = (
    DeviceSettings("camera", "purethermal", "simulated"),
    DeviceSettings("lux", "lutron", "simulated"),
    DeviceSettings("thermometer", "center-309", "simulated", every_s=2.0),
)


def record(scene):
    """What the three real drivers deliver of a scene, as text, per stream."""
    samples = {settings.name: [] for settings in INSTRUMENTS}
    with SimulatedClock(scene.start_ns) as clock, SimulatedField(scene, clock) as field:
        devices = [registry.open_device(field.plug(settings), clock) for settings in INSTRUMENTS]
        end_ns = clock.to_mono_ns(scene.end_ns)
        joined = threading.Barrier(len(devices) + 1)

        def read(device):
            with clock.taking_part():
                joined.wait()
                while clock.mono_ns() < end_ns:
                    if (sample := device.read(0.5)) is not None:
                        pixels = sample.counts.tobytes() if device.info.is_camera else sample.raw
                        samples[device.info.name].append((sample.mono_ns, sample.quality, pixels))

        threads = [threading.Thread(target=read, args=(one,), name=one.info.name) for one in devices]
        with clock.taking_part():
            for thread in threads:
                thread.start()
            joined.wait()
        for thread in threads:
            thread.join()
        for device in devices:
            device.close()
    return samples


def test_the_same_field_gives_the_same_bytes_and_stamps_however_busy_the_computer():
    scene = sand_slopes(duration_s=20.0, faults=(Fault(FaultKind.GARBLED, 5.0, 5.0),))
    quiet = record(scene)
    counts = [len(quiet[name]) for name in ("camera", "lux", "thermometer")]
    assert counts == pytest.approx([170, 17, 9], abs=6)
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
    try:
        assert record(scene) == quiet
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
