"""A step of the light is seen by camera, light meter and thermometer at one time.

The real drivers read simulated instruments; each stream is brought to the moment of
measurement by what it declares (latency, response), and by nothing else.
"""

import threading
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from fieldkit.drivers import registry
from fieldkit.drivers.simulated import SimulatedField
from fieldkit.model.device import DeviceSettings
from fieldkit.model.units import SECOND_NS
from fieldkit.simulation import Facet, LightStep, sand_slopes
from fieldkit.simulation.scene import ALAMOSA_NOON_NS
from fieldkit.simulation.simulated_clock import SimulatedClock

FOIL = Facet(
    # blackened aluminium foil on foam answers light at once; sand would creep
    "foil",
    ((40, 40), (120, 40), (120, 80), (40, 80)),
    depth_m=0.0001,
    conductivity_w_m_k=230.0,
    heat_capacity_j_m3_k=2.4e6,
    is_reference=True,
)
STEPS_S = {"shaded": 40.0, "lit": 80.0}
SHADE = 0.05  # of the light is left in between
INSTRUMENTS = (
    DeviceSettings("camera", "purethermal", "simulated"),
    DeviceSettings("lux", "lutron", "simulated", every_s=0.02),
    DeviceSettings("thermometer", "center-309", "simulated", every_s=0.1),
)
BEFORE_S, AFTER_S = 5.0, 6.0  # later the foil is no longer of first order: it radiates


@pytest.fixture(scope="module")
def streams():
    """(time since the start, value) of each instrument, at the moment of measurement."""
    down_ns, up_ns = (ALAMOSA_NOON_NS + round(at_s * SECOND_NS) for at_s in STEPS_S.values())
    steps = (LightStep(down_ns, SHADE), LightStep(up_ns, 1.0 / SHADE))
    scene = replace(sand_slopes(duration_s=100.0, light_steps=steps), facets=(FOIL,), response_s=0.5)
    with SimulatedClock(scene.start_ns) as clock, SimulatedField(scene, clock) as field:
        devices = [registry.open_device(field.plug(settings), clock) for settings in INSTRUMENTS]
        samples = read_until(clock, clock.to_mono_ns(scene.end_ns), devices)
        for device in devices:
            device.close()
    mask = scene.regions[0].mask((120, 160))
    seen = {}
    for device in devices:
        info = device.info
        time_s = [(one.time_ns - scene.start_ns) / SECOND_NS - info.latency_s for one in samples[info.name]]
        values = [
            one.counts[mask].mean() * info.scale if info.is_camera else one.values[0]
            for one in samples[info.name]
        ]
        seen[info.name] = (np.array(time_s), np.array(values), info)
    return seen


def read_until(clock, end_ns, devices):
    samples = {device.info.name: [] for device in devices}
    joined = threading.Barrier(len(devices) + 1)

    def read(device):
        with clock.taking_part():
            joined.wait()
            while clock.mono_ns() < end_ns:
                if (sample := device.read(0.5)) is not None:
                    samples[device.info.name].append(sample)

    threads = [threading.Thread(target=read, args=(device,), name=device.info.name) for device in devices]
    with clock.taking_part():
        for thread in threads:
            thread.start()
        joined.wait()
    for thread in threads:
        thread.join()
    return samples


def around(stream, at_s):
    time_s, values, info = stream
    near = (time_s > at_s - BEFORE_S) & (time_s < at_s + AFTER_S)
    return time_s[near], values[near], info


def jump_time(time_s, values):
    """Between the last reading on one side and the first on the other side of half way."""
    low = values < (values.min() + values.max()) / 2
    (change,) = np.nonzero(np.diff(low.astype(int)))[0]
    return (time_s[change] + time_s[change + 1]) / 2


def onset(time_s, values, guess_s, response_s, body_s=None):
    """(when a thin body began to warm or cool, its time constant), by a sensor of known response.

    Body and sensor are both of first order; level, slope before, size and onset are fitted,
    and the body's time constant unless it is known.
    """

    def residual(parameters):
        level, slope, size, onset_s, fitted_s = parameters
        own_s = body_s or fitted_s
        since = np.maximum(time_s - onset_s, 0.0)
        slow = own_s * np.exp(-since / own_s)
        fast = response_s * np.exp(-since / response_s) if response_s else 0.0
        return level + slope * (time_s - guess_s) + size * (1 - (slow - fast) / (own_s - response_s)) - values

    start = [values[0], 0.0, values[-1] - values[0], guess_s, 8.0]
    found = least_squares(residual, start, x_scale=[1.0, 0.01, 5.0, 0.1, 3.0])
    return found.x[3], found.x[4]


@pytest.mark.parametrize("step", STEPS_S)
def test_step_of_the_light_appears_within_50_ms_everywhere(streams, step):
    at_s = STEPS_S[step]
    lux_time, lux, _ = around(streams["lux"], at_s)
    time_s, kelvin, _ = around(streams["camera"], at_s)
    camera_s, foil_s = onset(time_s, kelvin, at_s, 0.0)
    time_s, kelvin, info = around(streams["thermometer"], at_s)
    thermometer_s, _ = onset(time_s, kelvin, at_s, info.response_s, foil_s)
    times = {"lux": jump_time(lux_time, lux), "camera": camera_s, "thermometer": thermometer_s}
    assert max(times.values()) - min(times.values()) < 0.050, times
    assert times == pytest.approx(dict.fromkeys(times, at_s), abs=0.050), "and that is when it happened"


def test_streams_disagree_where_latency_and_response_are_not_taken_out(streams):
    """The instruments do have latencies and lags: without them the test above would prove nothing."""
    at_s = STEPS_S["shaded"]
    lux_time, lux, info = around(streams["lux"], at_s)
    late_s = jump_time(lux_time + info.latency_s, lux) - at_s
    time_s, kelvin, info = around(streams["thermometer"], at_s)
    slow_s = onset(time_s + info.latency_s, kelvin, at_s, 0.0)[0] - at_s
    assert late_s > 0.1
    assert slow_s > 0.3
