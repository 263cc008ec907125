"""Temperatures of regions: calibrated offsets removed, shift by uncertain emissivities and second cameras.

Another emissivity of the camera's band turns the same reading into another temperature. Regions that share
the surface's emissivity shift together, so most of it cancels in the difference to the reference; a region
with an emissivity of its own shifts alone. Where the broadband emissivity of the balance follows the band's,
its effect is a scale error far below `EstimatorSettings.scale_sd` and is not counted again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.radiance import brightness_temperature_k, kelvin_per_emissivity, surface_temperature_k

CAMERA_OFFSET_SD_K = 0.5
"""Offset between two radiometric cameras; judged: shutters correct each camera by its own housing."""


def remove_offsets(history: History, regions: Sequence[Region], settings: EstimatorSettings) -> History:
    """The history without the calibrated offsets of its targets, nor the camera's errors by black bodies.

    `regions` are its columns.
    An offset is of brightness temperature, measured minus true. One kelvin of brightness temperature is more
    than one kelvin of surface temperature, so it is removed with the emissivity and reflection of the
    estimate.
    """
    kelvin = history.temperature_k - camera_error_k(history, regions)[:, np.newaxis]
    for column, region in enumerate(regions):
        offset_k = settings.offsets_k.get(region.name, 0.0) if region.kind is RegionKind.TARGET else 0.0
        if offset_k:
            own = region.emissivity
            surface = settings.surface.emissivity if np.isnan(own) else own, settings.reflected_temperature_k
            brightness = brightness_temperature_k(kelvin[:, column], *surface)
            kelvin[:, column] = surface_temperature_k(brightness - offset_k, *surface)
    return replace(history, temperature_k=kelvin)


def camera_error_k(history: History, regions: Sequence[Region]) -> FloatArray:
    """Error of the camera in each minute (n,) as black bodies show it; zero without any.

    It holds until their probes are read again; before the first reading it is NaN, as are all temperatures.
    """
    bodies = [column for column, region in enumerate(regions) if region.kind is RegionKind.BLACKBODY]
    if not bodies:
        return np.zeros(len(history))
    over_k = history.temperature_k[:, bodies] - history.probe_k[:, bodies]
    count = np.isfinite(over_k).sum(axis=1)
    error_k = np.append(np.nan, np.nansum(over_k, axis=1) / np.maximum(count, 1))
    # the last minute with a reading; 0, where there is none yet, is the NaN before all
    last = np.maximum.accumulate(np.where(count > 0, np.arange(1, len(history) + 1), 0))
    return np.asarray(error_k[last])


def uncertain_inputs(
    regions: Sequence[Region], settings: EstimatorSettings
) -> Iterator[tuple[str, float, list[int], float | None]]:
    """Name, standard uncertainty, columns and emissivity of each input that shifts temperatures of regions.

    Offsets of other cameras than that of the first region, in kelvin and without emissivity; then each
    emissivity with a stated uncertainty.
    """
    for camera in dict.fromkeys(region.camera for region in regions):
        if camera != regions[0].camera:
            columns = [column for column, region in enumerate(regions) if region.camera == camera]
            yield f"offset of {camera}", CAMERA_OFFSET_SD_K, columns, None
    common = [column for column, region in enumerate(regions) if math.isnan(region.emissivity)]
    if settings.emissivity_sd > 0.0 and common:
        yield "emissivity", settings.emissivity_sd, common, settings.surface.emissivity
    for column, region in enumerate(regions):
        sd = settings.own_emissivity_sd.get(region.name, 0.0)
        if sd > 0.0 and column not in common:
            yield f"emissivity of {region.name}", sd, [column], region.emissivity


def shifted_temperatures(
    temperature_k: FloatArray, regions: Sequence[Region], settings: EstimatorSettings
) -> Iterator[FloatArray]:
    """Temperatures (n, regions) with each of `uncertain_inputs` a standard uncertainty higher.

    Those of surfaces, with their emissivities and the uncertainties of these by the settings; `regions` are
    the columns.
    """
    for _, sd, columns, emissivity in uncertain_inputs(regions, settings):
        shifted = temperature_k.copy()
        per_input: FloatArray | float = 1.0
        if emissivity is not None:
            reflected_k = settings.reflected_temperature_k
            per_input = kelvin_per_emissivity(shifted[:, columns], emissivity, reflected_k)
        shifted[:, columns] += sd * per_input
        yield shifted


def difference_covariance_k2(
    temperature_k: FloatArray, regions: Sequence[Region], settings: EstimatorSettings
) -> FloatArray:
    """Covariance (n - 1, n - 1) of the differences to the first of n regions in a minute from emissivities
    and cameras.

    Surface temperatures (n,); the other arguments are as for `shifted_temperatures`.
    """
    one_minute = temperature_k[np.newaxis]
    shifts = [(shifted - one_minute)[0] for shifted in shifted_temperatures(one_minute, regions, settings)]
    differences = np.reshape([shift[1:] - shift[0] for shift in shifts], (-1, len(regions) - 1))
    return np.asarray(differences.T @ differences)


def difference_k(
    bed_k: FloatArray, reference_k: FloatArray, bed: Region, reference: Region, settings: EstimatorSettings
) -> FloatArray:
    """Standard uncertainty of target minus reference (n,) from emissivities and cameras, kelvin."""
    both = np.column_stack([bed_k, reference_k])
    shifts = [shifted - both for shifted in shifted_temperatures(both, (bed, reference), settings)]
    squares = [(shift[:, 0] - shift[:, 1]) ** 2 for shift in shifts]
    return np.sqrt(np.sum(squares, axis=0)) if squares else np.zeros(len(both))
