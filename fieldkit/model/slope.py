"""A slope estimate for one region and minute, its state, and the rule for the final estimate of a session.

`tilt` is the angle of the surface from horizontal, `azimuth` the direction of its normal from north,
clockwise; both in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldkit.model.numbered import NumberedEnum
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind

NAN = float("nan")


class SlopeState(NumberedEnum):
    """State of a slope estimate; the numbers are stored in the session file."""

    OK = 0
    TOO_FEW = 1  # not enough minute bins in the window yet
    NOT_RESOLVED = 2  # more than one slope fits
    FLAT = 3  # the likelihood region contains the vertical normal
    NO_INTERSECTION = 4  # no slope fits all minute bins (the paper's Fig. 14)
    HELD_CLOUD = 5  # the last estimate before the cloud is held
    LOW_SUN = 6
    SHADED = 7
    NO_DATA = 8  # no frames, no irradiance or no reference in the window
    UNCERTAIN = 9  # one slope fits, but its likelihood region is too wide to rely on (`is_too_wide`)


CERTAIN = (SlopeState.OK, SlopeState.FLAT)
"""States of a slope that may be relied on as it stands."""
SOLVED = (*CERTAIN, SlopeState.UNCERTAIN, SlopeState.NOT_RESOLVED)
"""States with a slope estimated at that very minute; only these count in mean errors."""
WITH_SLOPE = (*SOLVED, SlopeState.HELD_CLOUD)
"""States with a slope: a held one is an earlier estimate."""
CERTAIN_WITHIN_DEG = 3.0
"""Widest 90 % region of a certain flat or gentle slope: the change of tilt by a tenth of a kelvin where one
kelvin is 30 degrees, the limit in the plan of a day."""
CERTAIN_SHARE = 0.2
"""The same for a steep slope, as a share of its tilt: 30 degrees within 27..33."""


def is_too_wide(tilt_deg: ArrayLike, low_deg: ArrayLike, high_deg: ArrayLike) -> NDArray[np.bool_]:
    """Whether a tilt with these bounds of its 90 % region is uncertain; true if a bound is NaN.

    Parameters
    ----------
    tilt_deg, low_deg, high_deg
        Tilt and its bounds, any shapes that broadcast. [degrees]
    """
    width = np.subtract(high_deg, low_deg)
    return ~np.asarray(width <= np.maximum(CERTAIN_WITHIN_DEG, np.multiply(CERTAIN_SHARE, tilt_deg)))


@dataclass(frozen=True, slots=True)
class SlopeEstimate:
    """Slope of one region from the minute bins `window_start_ns`..`time_ns`.

    Angles in degrees, NaN where not determined; bounds are the projections of the 90 %
    likelihood region with noise and the stated systematic uncertainties, the `noise_` bounds those of noise
    alone. Azimuth bounds are unwrapped (low <= azimuth
    <= high, so below 0 or above 360 across north). `kelvin_per_degree` is the change of
    surface temperature per degree of tilt at `time_ns`. `chi_square` is reduced (per degree
    of freedom). `reason` explains in words why the state is not `OK`. Every field is a column of the session
    file and of its journal.
    """

    time_ns: int
    region: str
    state: SlopeState
    tilt_deg: float = NAN
    azimuth_deg: float = NAN
    tilt_low_deg: float = NAN
    tilt_high_deg: float = NAN
    azimuth_low_deg: float = NAN
    azimuth_high_deg: float = NAN
    second_tilt_deg: float = NAN
    second_azimuth_deg: float = NAN
    kelvin_per_degree: float = NAN
    chi_square: float = NAN
    flags: Quality = Quality.GOOD
    window_start_ns: int = 0
    n_bins: int = 0
    model: str = ""
    reason: str = ""
    noise_tilt_low_deg: float = NAN
    noise_tilt_high_deg: float = NAN
    noise_azimuth_low_deg: float = NAN
    noise_azimuth_high_deg: float = NAN

    def __repr__(self) -> str:
        tilt = f"tilt {self.tilt_deg:.1f}° ({self.tilt_low_deg:.1f} to {self.tilt_high_deg:.1f})"
        second = f", or {self.second_tilt_deg:.1f}°" if math.isfinite(self.second_tilt_deg) else ""
        return f"<{self.region}: {tilt}{second}, azimuth {self.azimuth_deg:.0f}°, {self.state.name.lower()}>"


def is_certain(estimate: SlopeEstimate) -> bool:
    """Whether a slope may be relied on, current or held: a single branch fits, within a narrow region."""
    is_single = estimate.state in (*CERTAIN, SlopeState.HELD_CLOUD) and not math.isfinite(
        estimate.second_tilt_deg
    )
    return is_single and not is_too_wide(estimate.tilt_deg, estimate.tilt_low_deg, estimate.tilt_high_deg)


def final_estimate(estimates: Iterable[SlopeEstimate]) -> SlopeEstimate | None:
    """The last estimate of one region, in order of time, that has a slope; else the last one."""
    final: SlopeEstimate | None = None
    for estimate in estimates:
        if final is None or estimate.state in WITH_SLOPE or final.state not in WITH_SLOPE:
            final = estimate
    return final


def final_estimates(
    estimates: Iterable[SlopeEstimate], regions: Sequence[Region]
) -> dict[str, SlopeEstimate]:
    """The final estimate of each target that was estimated, in the order of the regions."""
    targets = [region.name for region in regions if region.kind is RegionKind.TARGET]
    by_region: dict[str, list[SlopeEstimate]] = {name: [] for name in targets}
    for estimate in estimates:
        by_region.setdefault(estimate.region, []).append(estimate)
    found = {name: final_estimate(by_region[name]) for name in targets}
    return {name: final for name, final in found.items() if final is not None}
