"""Offsets of brightness are taken from what the camera saw, whatever emissivity each bed has."""

from dataclasses import replace

import numpy as np
import pytest

from fieldkit.estimation.bins import History
from fieldkit.estimation.region_temperatures import remove_offsets
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.radiance import brightness_temperature_k, surface_temperature_k

CORNERS = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))


@pytest.mark.parametrize(("own", "used"), [(float("nan"), 0.90), (0.85, 0.85), (0.98, 0.98)])
def test_an_offset_of_brightness_leaves_nothing(own, used):
    settings = EstimatorSettings(offsets_k={"b15": 1.0, "flat": 1.0})
    assert settings.surface.emissivity == 0.90
    reflected = settings.reflected_temperature_k
    regions = (
        Region("flat", RegionKind.REFERENCE, CORNERS),
        Region("b15", RegionKind.TARGET, CORNERS, emissivity=own),
    )
    true = np.array([[295.0, 300.0], [296.0, 305.0]])
    seen = true.copy()
    seen[:, 1] = surface_temperature_k(
        brightness_temperature_k(true[:, 1], used, reflected) + 1.0, used, reflected
    )
    columns = {name: np.zeros(2) for name in History.__slots__}
    history = replace(History(**columns), temperature_k=seen)
    assert remove_offsets(history, regions, settings).temperature_k == pytest.approx(true, abs=1e-6)
    assert np.array_equal(history.temperature_k, seen)
