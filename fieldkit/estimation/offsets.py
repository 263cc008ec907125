"""Known offsets of regions, as a calibration of uniformity gives them: brightness measured minus true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.radiance import brightness_temperature_k, surface_temperature_k


def without_offsets(history: History, regions: Sequence[Region], settings: EstimatorSettings) -> History:
    """The history had the camera seen no offset of its targets; `regions` are its columns.

    A kelvin of brightness is more than one of the surface, by the emissivity with which it was found.
    """
    kelvin = history.temperature_k.copy()
    for column, region in enumerate(regions):
        offset_k = settings.offsets_k.get(region.name, 0.0) if region.kind is RegionKind.TARGET else 0.0
        if offset_k:
            own = region.emissivity
            seen = settings.surface.emissivity if np.isnan(own) else own, settings.reflected_temperature_k
            brightness = brightness_temperature_k(kelvin[:, column], *seen)
            kelvin[:, column] = surface_temperature_k(brightness - offset_k, *seen)
    return replace(history, temperature_k=kelvin)
