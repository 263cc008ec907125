"""What an uncertain emissivity of the camera's band does to temperatures, as one more systematic uncertainty.

The camera's reading stays; another emissivity makes another temperature of it. Regions that take the
surface's emissivity move together, so most of it cancels in the difference to the reference; one with an
emissivity of its own moves alone. The broadband emissivity of the balance, where it follows the band's, is a
scale error far below `EstimatorSettings.scale_sd` and is not counted again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.radiance import brightness_temperature_k, kelvin_per_emissivity, surface_temperature_k


def remove_offsets(history: History, regions: Sequence[Region], settings: EstimatorSettings) -> History:
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


def shifted_temperatures(
    temperature_k: FloatArray, regions: Sequence[Region], settings: EstimatorSettings
) -> Iterator[FloatArray]:
    """Temperatures were one emissivity a standard uncertainty higher, for each that has one.

    `temperature_k` (n, regions) as estimated, kelvin; each answer has the same shape.
    """
    own = [column for column, region in enumerate(regions) if not math.isnan(region.emissivity)]
    common = [column for column in range(len(regions)) if column not in own]
    surface = settings.surface.emissivity
    causes = [(common, surface, settings.emissivity_sd)]
    causes += [
        ([column], regions[column].emissivity, settings.own_emissivity_sd.get(regions[column].name, 0.0))
        for column in own
    ]
    for columns, emissivity, sd in causes:
        if sd > 0.0 and columns:
            moved = temperature_k.copy()
            seen = temperature_k[:, columns]
            moved[:, columns] += sd * kelvin_per_emissivity(
                seen, emissivity, settings.reflected_temperature_k
            )
            yield moved


def difference_k(
    bed_k: FloatArray, reference_k: FloatArray, bed: Region, reference: Region, settings: EstimatorSettings
) -> FloatArray:
    """Standard uncertainty of bed minus reference (n,) that comes of emissivities, kelvin."""
    both = np.column_stack([bed_k, reference_k])
    moves = [moved - both for moved in shifted_temperatures(both, (bed, reference), settings)]
    squares = [(move[:, 0] - move[:, 1]) ** 2 for move in moves]
    return np.sqrt(np.sum(squares, axis=0)) if squares else np.zeros(len(both))
