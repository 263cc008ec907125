"""Regions of known slope: to learn from, and to compare with."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fieldkit.model.errors import ConfigError
from fieldkit.model.region_schedule import Regions, RegionSchedule
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.facet import FloatArray, normal

LEAST_TILT_DEG = 3.0
"""Flatter regions hardly differ from the reference, whatever kappa is."""


@dataclass(frozen=True, slots=True)
class KnownSlope:
    """A target region of known slope: its column among the targets, tilt and azimuth in degrees."""

    column: int
    tilt_deg: float
    azimuth_deg: float

    def normal(self, steeper_deg: float = 0.0) -> FloatArray:
        """Unit normal (3,), of a slope that is `steeper_deg` steeper."""
        return normal(self.tilt_deg + steeper_deg, self.azimuth_deg)


def known_slopes(regions: Sequence[Region], beds: Sequence[str], path: Path) -> dict[str, KnownSlope]:
    """Target regions of known slope by name, or those of `beds`.

    Raises `ConfigError` if a region of `beds` is not one of them.
    """
    targets = [region for region in regions if region.kind is RegionKind.TARGET]
    known = {
        region.name: KnownSlope(column, region.tilt_deg, region.azimuth_deg)
        for column, region in enumerate(targets)
        if np.isfinite(region.azimuth_deg) and region.tilt_deg >= LEAST_TILT_DEG
    }
    for bed in beds:
        if bed not in known:
            raise ConfigError(
                f"{path}: region {bed} has no known slope",
                fix=f"known are {', '.join(known) or 'none'}; give tilt_deg",
            )
    return {name: slope for name, slope in known.items() if not beds or name in beds}


def with_known(regions: Regions, beds: Collection[str], steeper_deg: float = 0.0) -> RegionSchedule:
    """Regions to learn from: targets of `beds` as references, all of them steeper by `steeper_deg`.

    The flattest stays a target if no other is left: it would tell least as a reference.
    """
    schedule = RegionSchedule.of(regions)
    targets = [region for region in schedule.latest if region.kind is RegionKind.TARGET]
    known = sorted((one for one in targets if one.name in beds), key=lambda region: region.tilt_deg)
    if len(known) == len(targets):
        known = known[1:]
    names = {region.name for region in known}
    columns = (
        replace(region, kind=RegionKind.REFERENCE, tilt_deg=region.tilt_deg + steeper_deg)
        if region.name in names
        else region
        for region in schedule.columns
    )
    return replace(schedule, columns=tuple(columns))
