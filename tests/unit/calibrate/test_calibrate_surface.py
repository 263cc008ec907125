from types import SimpleNamespace

import numpy as np
import pytest

from fieldkit.calibrate.surface import fit_exchange
from fieldkit.estimation.bins import History
from fieldkit.estimation.scale import KnownSlope
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.physics.energy_balance import SurfaceParameters, irradiance_per_kelvin, surface_temperature
from fieldkit.physics.facet import VERTICAL, normal
from fieldkit.physics.sun import sun_vectors

SITE = Site(35.558675, 139.395232, 9.0)
BED = (25.0, 90.0)
SURFACE = SurfaceParameters()
CORNERS = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))


def test_exchange_of_heat_is_not_told_from_minutes_in_own_shade():
    start = int(np.datetime64("2017-08-30T03:00", "ns").astype(np.int64))
    time_ns = start + np.arange(320) * 60_000_000_000
    sun = sun_vectors(time_ns, SITE)
    sunlight = np.maximum(sun @ np.stack([VERTICAL, normal(*BED)]).T, 0.0)
    assert (sunlight[:, 1] == 0.0).sum() > 60
    kelvin = surface_temperature(800.0 * sunlight, 400.0, 303.15, SURFACE)
    history = History(time_ns // 60_000_000_000, time_ns, sun, kelvin, np.full(320, 800.0))
    regions = (Region("flat", RegionKind.REFERENCE, CORNERS), Region("bed", RegionKind.TARGET, CORNERS, *BED))
    estimator = SimpleNamespace(regions=regions, settings=EstimatorSettings(model="paper", surface=SURFACE))
    found = fit_exchange(estimator, history, {"bed": KnownSlope(0, *BED)})
    lit = sunlight[:, 1] > 0.03
    expected = float(irradiance_per_kelvin(kelvin[lit, 0].mean(), SURFACE))
    assert found.steepness_w_m2_k == pytest.approx(expected, rel=1e-3)
