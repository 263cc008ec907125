"""The same field recorded without the lab: fieldkit's simulated instruments on a simulated clock."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from fieldkit.config import load_config
from fieldkit.drivers import registry
from fieldkit.drivers.simulated import PORT, SimulatedField
from fieldkit.recording.opening import Instruments, open_all
from fieldkit.recording.record import PreparedRecording
from fieldkit.simulation import Scene
from fieldkit.simulation.simulated_clock import SimulatedClock
from fieldlab.campaign import toml


def tilts_deg(scene: Scene, start_ns: int, duration_s: float, folder: Path) -> dict[str, float]:
    """The last estimate of each region's tilt from a recording that begins at `start_ns` (UTC)."""
    (folder / "fieldkit.toml").write_text(toml(scene))
    config = load_config(folder / "fieldkit.toml")
    with SimulatedClock(start_ns, math.inf) as clock, SimulatedField(scene, clock) as field:
        plugged = {one.name: field.plug(replace(one, port=PORT, identity="")) for one in config.devices}
        tools = Instruments(
            open_all(list(plugged.values()), clock),
            clock,
            lambda name: registry.open_device(plugged[name], clock),
            lambda: 10**12,
        )
        prepared = PreparedRecording(config, tools, folder / "reference.h5", duration_s=duration_s)
        summary = prepared.run().summary
        for device in tools.devices:
            device.close()
    assert summary.last_minute is not None
    return {estimate.region: estimate.tilt_deg for estimate in summary.last_minute.estimates}
