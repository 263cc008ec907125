"""The far ends of simulated cables: instruments that look at a scene, read by the real drivers.

`SimulatedField` connects them, `lepton` is the cameras' source of buffers, `meters` reply on
pseudo-terminals. To simulate another instrument, write its far end and add it to `CAMERAS` or `METERS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from fieldkit.drivers.simulated.lepton import LATENCY_S, SimulatedLepton, SimulatedTCam, SimulatedY16
from fieldkit.drivers.simulated.meters import SimulatedCenter309, SimulatedLutron, SimulatedMeter
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.fault_kind import FaultKind
from fieldkit.simulation import Scene
from fieldkit.simulation.faults import CLOCK_STEP_S
from fieldkit.simulation.simulated_clock import SimulatedClock

PORT = "simulated"
"""Port of a simulated instrument in the configuration."""

CAMERAS: Mapping[str, type[SimulatedLepton]] = {
    "purethermal": SimulatedLepton,
    "tcam": SimulatedTCam,
    "y16": SimulatedY16,
}
METERS: Mapping[str, type[SimulatedMeter]] = {"lutron": SimulatedLutron, "center-309": SimulatedCenter309}


class SimulatedField:
    """The instruments of a scene, running by a clock; a context manager.

    The drivers are the real ones: a meter's gets the path of a pseudo-terminal, a camera's
    a source of buffers. `camera_offsets_k` are by the camera's name.
    """

    def __init__(
        self,
        scene: Scene,
        clock: SimulatedClock,
        camera_offsets_k: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._scene, self._clock, self._camera_offsets_k = scene, clock, camera_offsets_k
        self._meters: list[SimulatedMeter] = []
        for begin_ns, _ in scene.fault_spans(FaultKind.CLOCK):
            clock.call_at(clock.to_mono_ns(begin_ns), lambda: clock.step_system_clock(CLOCK_STEP_S))

    def plug(self, settings: DeviceSettings) -> DeviceSettings:
        """Settings that lead the driver to a simulated instrument, if their port is "simulated".

        Latency and response of the instrument are declared in the options unless they are
        given there. Raises `ConfigError` for a driver whose instrument is not simulated.
        """
        if settings.port != PORT:
            return settings
        if (camera := CAMERAS.get(settings.driver)) is not None:
            options = {"latency_s": LATENCY_S, **settings.options}
            source = camera(self._scene, self._clock, self._camera_offsets_k.get(settings.name, 0.0))
            source.settings = settings
            return replace(settings, options=options, source=source)
        if (meter := METERS.get(settings.driver)) is not None:
            instrument = meter(self._scene, self._clock, settings)
            self._meters.append(instrument)
            return replace(
                settings, port=instrument.path, options={**instrument.timing_options(), **settings.options}
            )
        raise ConfigError(
            f"there is no simulated instrument for the driver {settings.driver!r}",
            place=settings.name,
            fix=f"choose a simulated one: {', '.join((*CAMERAS, *METERS))}",
        )

    def disk_free_bytes(self, real: int) -> int:
        """Free space now: the `real` one unless the scene's fault takes it away."""
        return self._scene.disk_free_bytes(self._clock.to_utc_ns(self._clock.mono_ns()), real)

    def close(self) -> None:
        """Pull all plugs; a second call does nothing."""
        for meter in self._meters:
            meter.close()
        self._meters.clear()

    def __enter__(self) -> SimulatedField:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
