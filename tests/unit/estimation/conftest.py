"""A small field whose samples follow the paper's own balance, eq. (7), so slopes are known exactly."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame, Quality, Reading
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.energy_balance import surface_temperature
from fieldkit.physics.facet import normal
from fieldkit.physics.radiance import brightness_temperature_k
from fieldkit.physics.sun import sun_vectors
from tests.harness.papers_field import SITE, SURFACE, utc_ns

MINUTE_NS = 60 * SECOND_NS
SHAPE = (60, 80)
EQ10_DIVISOR = 4.57 * 54.0


def box(x: int, y: int) -> tuple[tuple[float, float], ...]:
    return ((x, y), (x + 14, y), (x + 14, y + 20), (x, y + 20))


mask = cache(lambda bed: bed.mask(SHAPE))


@dataclass
class Yard:
    """Beds at the paper's site; `samples` makes what a camera, a lux meter and a thermometer would say."""

    site: Site = SITE
    start_ns: int = utc_ns("2017-08-30T00:00")
    beds: tuple[Region, ...] = (
        Region("flat", RegionKind.REFERENCE, box(2, 2)),
        Region("b08", RegionKind.TARGET, box(22, 2), 8.0, 140.0),
        Region("b17", RegionKind.TARGET, box(42, 2), 17.0, 250.0),
        Region("b25", RegionKind.TARGET, box(62, 2), 25.0, 10.0),
    )
    streams: tuple[StreamInfo, ...] = (
        StreamInfo("camera", "brightness_temperature", "K", SHAPE, scale=0.01),
        StreamInfo("lux", "illuminance", "lx", (1,)),
        StreamInfo("contact", "temperature", "K", (2,), channels=("sand", "air")),
    )
    dni_w_m2: float = 800.0
    noise_k: float = 0.0
    shade: dict[str, range] = field(default_factory=dict)
    clouds: range = range(0)

    def light(self, minute: int) -> float:
        return self.dni_w_m2 * (0.4 if minute in self.clouds else 1.0)

    def counts(self, time_ns: int, minute: int, random: np.random.Generator) -> np.ndarray:
        sun = sun_vectors(time_ns, self.site)
        kelvin = np.full(SHAPE, 300.0)
        for bed in self.beds:
            tilt, azimuth = np.nan_to_num([bed.tilt_deg, bed.azimuth_deg])
            direct = 0.0 if minute in self.shade.get(bed.name, ()) else self.light(minute)
            absorbed = direct * max(0.0, float(normal(tilt, azimuth) @ sun))
            surface = surface_temperature(absorbed, 400.0, 303.15, SURFACE)
            kelvin[mask(bed)] = brightness_temperature_k(surface, 0.90, 233.15)
        noisy = kelvin + self.noise_k * random.standard_normal(SHAPE)
        return np.round(noisy / 0.01).astype(np.uint16)

    def samples(
        self, minutes: int, frames: int = 2, quality: Quality = Quality.GOOD
    ) -> list[Frame | Reading]:
        """In order of time: a burst each minute, lux every 5 s, the thermometer every 20 s."""
        random = np.random.default_rng(1)
        made: list[Frame | Reading] = []
        none = np.zeros((0, SHAPE[1]), np.uint16)
        for minute in range(minutes):
            begin = self.start_ns + minute * MINUTE_NS
            for frame in range(frames):
                at = begin + frame * SECOND_NS
                made.append(Frame("camera", at + 7, at, self.counts(at, minute, random), none, quality))
            for second in range(0, 60, 5):
                at = begin + second * SECOND_NS + 1
                horizontal = self.light(minute) * float(sun_vectors(at, self.site)[2]) / 0.85
                made.append(Reading("lux", at + 7, at, (horizontal * 0.44 * EQ10_DIVISOR,)))
                if second % 20 == 0:
                    made.append(Reading("contact", at + 7, at, (304.15, float("nan"))))
        return sorted(made, key=lambda sample: sample.time_ns)


@pytest.fixture(scope="session")
def yard():
    return Yard()
