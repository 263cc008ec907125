import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldkit.drivers import registry
from fieldkit.drivers.meters import center, lutron
from fieldkit.drivers.simulated import SimulatedField
from fieldkit.drivers.simulated.meters import center_309_record, lutron_record
from fieldkit.model.channels import air_quantities
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceLostError
from fieldkit.model.fault_kind import FaultKind
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation import Fault, sand_slopes
from fieldkit.simulation.simulated_clock import SimulatedClock

LUX = DeviceSettings("lux", "lutron", "simulated")
THERMOMETER = DeviceSettings("thermometer", "center-309", "simulated", every_s=2.0)


def opened(instrument, scene):
    """Clock, field and the real driver's device for one simulated instrument; close all three."""
    clock = SimulatedClock(scene.start_ns)
    field = SimulatedField(scene, clock)
    return clock, field, registry.open_device(field.plug(instrument), clock)


@pytest.fixture(scope="module")
def scene():
    return sand_slopes(duration_s=600.0)


@pytest.fixture
def lux(scene):
    clock, field, device = opened(LUX, scene)
    with clock, field:
        yield device
        device.close()


@pytest.fixture
def thermometer(scene):
    clock, field, device = opened(THERMOMETER, scene)
    with clock, field:
        yield device
        device.close()


# --- bytes: read back by drivers that read the golden records of the protocol sheets


@given(st.floats(-2e5, 4e5))
def test_driver_reads_back_what_the_light_meter_says(value):
    (read,) = lutron.Lutron().decode(lutron_record(value, "15"), {}).values
    assert read.value == pytest.approx(value, rel=1e-4, abs=0.00501)


@given(st.lists(st.floats(-200.0, 1300.0) | st.just(math.nan), max_size=4))
def test_driver_reads_back_what_the_thermometer_says(celsius):
    read = [value.value for value in center.Center309().decode(center_309_record(celsius), {}).values]
    expected = [*celsius, *[math.nan] * (4 - len(celsius))]
    np.testing.assert_allclose(read, expected, atol=0.0501)


# --- instruments at the end of a real pseudo-terminal


def test_light_meter_tells_the_scene_as_it_was_when_it_measured(lux, scene):
    lux.read(2.0)
    for _ in range(5):
        reading = lux.read(2.0)
        measured_ns = reading.time_ns - round(lux.info.latency_s * SECOND_NS)
        assert reading.values == (round(scene.lux_reading(measured_ns)),)


def test_thermometer_tells_its_probes_as_they_were_when_it_measured(thermometer, scene):
    for _ in range(5):
        reading = None
        while reading is None:
            reading = thermometer.read(1.0)
        probes = scene.probe_readings(reading.time_ns - round(thermometer.info.latency_s * SECOND_NS))
        np.testing.assert_allclose(reading.values, probes, atol=0.0501)


def test_probe_named_as_air_hangs_in_the_air_and_the_others_lie_in_the_beds(scene):
    labelled = replace(THERMOMETER, options={"labels": ["T1", "air", "T3", "T4"]})
    clock, field, device = opened(labelled, scene)
    with clock, field:
        reading = None
        while reading is None:
            reading = device.read(1.0)
        time_ns = reading.time_ns - round(device.info.latency_s * SECOND_NS)
        device.close()
    flat, b05, b15, _ = scene.probe_readings(time_ns)
    np.testing.assert_allclose(reading.values, [flat, scene.air_reading(time_ns), b05, b15], atol=0.0501)
    assert air_quantities(device.info) == ("", "air_temperature", "", "")
    # NOAA, SURFRAD, slv16001.dat, 19:00 UTC
    assert scene.air_reading(time_ns) - 273.15 == pytest.approx(-6.5, abs=0.2)


def test_pulled_plug_is_a_lost_device(scene):
    clock, field, device = opened(LUX, scene)
    with clock:
        device.read(2.0)
        field.close()
        with pytest.raises(DeviceLostError):
            device.read(2.0)
        device.close()


@pytest.mark.parametrize("settings", [LUX, THERMOMETER], ids=lambda settings: settings.driver)
def test_garbled_bytes_are_rejected_and_good_ones_come_back(settings):
    scene = sand_slopes(duration_s=300.0, faults=(Fault(FaultKind.GARBLED, 60.0, 120.0),))
    clock, field, device = opened(settings, scene)
    begin_ns, end_ns = scene.fault_spans(FaultKind.GARBLED)[0]
    counts = {"before": 0, "during": 0, "after": 0}
    rejected = {}
    with clock, field:
        while clock.mono_ns() < clock.to_mono_ns(scene.end_ns):
            reading = device.read(0.5)
            now_ns = clock.to_utc_ns(clock.mono_ns())
            when = "before" if now_ns < begin_ns else "during" if now_ns < end_ns else "after"
            counts[when] += reading is not None
            rejected[when] = device.rejected
        device.close()
    every_s = settings.every_s
    assert rejected["before"] == 0
    assert rejected["during"] > 3
    assert rejected["after"] <= rejected["during"] + 1, "the last spoilt bytes at most"
    assert counts["before"] >= 55 / every_s
    assert 0 < counts["during"] < 0.6 * 120 / every_s
    assert counts["after"] >= 115 / every_s
