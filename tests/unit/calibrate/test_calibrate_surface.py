from types import SimpleNamespace

import numpy as np
import pytest

from fieldkit.calibrate.surface import fit_exchange
from fieldkit.estimation.bins import History
from fieldkit.estimation.scale import KnownSlope
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import irradiance_per_kelvin
from fieldkit.physics.facet import VERTICAL, normal
from tests.harness.papers_field import SURFACE, suns, temperatures_k, utc_ns

BED = (25.0, 90.0)
CORNERS = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))


def test_exchange_of_heat_is_not_told_from_minutes_in_own_shade():
    sun, minute = suns("2017-08-30T03:00", 320), utc_ns("2017-08-30T03:00") // MINUTE_NS + np.arange(320)
    facets = np.stack([VERTICAL, normal(*BED)])
    assert (sun @ facets[1] <= 0.0).sum() > 60
    kelvin = temperatures_k(facets, sun).T
    history = History(minute, minute * MINUTE_NS, sun, kelvin, np.full(320, 800.0))
    regions = (Region("flat", RegionKind.REFERENCE, CORNERS), Region("bed", RegionKind.TARGET, CORNERS, *BED))
    estimator = SimpleNamespace(regions=regions, settings=EstimatorSettings(model="paper", surface=SURFACE))
    found = fit_exchange(estimator, history, {"bed": KnownSlope(0, *BED)})
    lit = sun @ facets[1] > 0.03
    expected = float(irradiance_per_kelvin(kelvin[lit, 0].mean(), SURFACE))
    assert found.steepness_w_m2_k == pytest.approx(expected, rel=1e-3)
