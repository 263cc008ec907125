"""A small field for the views: a reference, two beds, three instruments."""

import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame, Quality
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState

SECOND_NS = 10**9
START_NS = 1_512_961_680 * SECOND_NS  # 2017-12-11 12:08 JST, a whole minute


def box(left: float, top: float, right: float, bottom: float) -> tuple[tuple[float, float], ...]:
    return ((left, top), (right, top), (right, bottom), (left, bottom))


@pytest.fixture(scope="session")
def site():
    return Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")  # the paper's


@pytest.fixture(scope="session")
def regions():
    return (
        Region("flat", RegionKind.REFERENCE, box(2, 20, 12, 28), 0.0, 0.0),
        Region("b15", RegionKind.TARGET, box(16, 20, 24, 28), 15.0, 180.0),
        Region("b25", RegionKind.TARGET, box(28, 4, 38, 14), 25.0, 180.0),
    )


@pytest.fixture(scope="session")
def streams():
    return (
        StreamInfo("camera", "brightness_temperature", "K", (30, 40), scale=0.01, rate_hz=9.0),
        StreamInfo("lux", "illuminance", "lx", (1,), channels=("lux",), rate_hz=1.0),
        StreamInfo("thermometer", "temperature", "K", (2,), channels=("flat", "b15"), rate_hz=1.0),
    )


@pytest.fixture
def frame(regions):
    """290 K all over, 300 K on the flat, 310 K on b15, 320 K on b25."""
    kelvin = np.full((30, 40), 290.0)
    for region, temperature in zip(regions, (300.0, 310.0, 320.0), strict=True):
        kelvin[region.mask((30, 40))] = temperature
    counts = np.rint(kelvin * 100).astype(np.uint16)
    return Frame("camera", 0, START_NS, counts, np.empty((0, 40), np.uint16))


@pytest.fixture
def make_minute(regions):
    """A minute `index` after the start: b15 as told, b25 with a second branch."""
    from fieldkit.estimation.estimator import Minute

    def make(index: int = 0, *, tilt_deg: float = 15.5, state: SlopeState = SlopeState.OK, **changes: object):
        time_ns = START_NS + index * 60 * SECOND_NS
        estimates = (
            SlopeEstimate(time_ns, "b15", state, tilt_deg, 178.0, tilt_deg - 1.4, tilt_deg + 1.6, 170, 190,
                          kelvin_per_degree=0.33),
            SlopeEstimate(time_ns, "b25", SlopeState.NOT_RESOLVED, 24.0, 181.0, 23.0, 25.0, 170.0, 190.0,
                          43.3, 181.0, kelvin_per_degree=0.26),
        )  # fmt: skip
        given = {
            "time_ns": time_ns,
            "estimates": estimates,
            "temperature_k": {"flat": 300.0, "b15": 310.0, "b25": 320.0},
            "spread_k": {"flat": 0.21, "b15": 0.2, "b25": 0.3},
            "pixels": {"flat": 99, "b15": 81, "b25": 121},
            "illuminance_lx": 55_210.0,
            "dni_w_m2": 835.0,
            "irradiance_model": "eq10 /0.44, diffuse 15%, horizontal",
            "sun_zenith_deg": 58.84,
            "sun_azimuth_deg": 186.57,
            "contact_k": (299.9, 309.5),
            "flags": Quality.GOOD,
            "events": (),
        }
        return Minute(**{**given, **changes})

    return make
