"""A slope estimate for one region and minute, its state, and the rule for the final estimate of a session.

`tilt` is the angle of the surface from horizontal, `azimuth` the direction of its normal from north,
clockwise; both in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import BoolArray, FloatArray
from fieldkit.model.confidence import CONFIDENCE
from fieldkit.model.samples import NumberedEnum, Quality
from fieldkit.model.site import Region, RegionKind

NAN = float("nan")
K = TypeVar("K")


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
    WIDE = 9  # one slope fits, but is not known well enough for the purpose (`is_too_wide`)


CERTAIN = (SlopeState.OK, SlopeState.FLAT)
"""States of a slope that may be relied on as it stands."""
SOLVED = (*CERTAIN, SlopeState.WIDE, SlopeState.NOT_RESOLVED)
"""States with a slope estimated at that very minute; only these count in mean errors."""
WITH_SLOPE = (*SOLVED, SlopeState.HELD_CLOUD)
"""States with a slope: a held one is an earlier estimate."""
TARGET_HALF_WIDTH_DEG = 2.0
"""Half-width of a tilt's region that is narrow enough, where no other is configured: classes of slopes that
rovers distinguish are 5 degrees apart."""
STEEP_SHARE = 0.15
"""The same for a steep slope, as a share of its tilt: 30 degrees within 25.5..34.5."""


def is_too_wide(tilt_deg: ArrayLike, half_width_deg: ArrayLike, target_deg: float) -> BoolArray:
    """True if tilts with these half-widths are wide where `target_deg` is narrow enough; true for NaN."""
    return ~np.asarray(half_width_deg <= np.maximum(target_deg, np.multiply(STEEP_SHARE, tilt_deg)))


def half_width_deg(tilt_deg: ArrayLike, low_deg: ArrayLike, high_deg: ArrayLike) -> FloatArray:
    """Half the width of regions of tilts, as the number behind ± is everywhere; arrays or numbers alike.

    A region that begins at 0 was cut there: its upper part stands for the lower one where it is longer.
    """
    half = 0.5 * np.subtract(high_deg, low_deg)
    return np.where(np.equal(low_deg, 0.0), np.maximum(half, np.subtract(high_deg, tilt_deg)), half)


@dataclass(frozen=True, slots=True)
class SlopeField:
    """One number of a slope, as every table, file and document has it.

    `key` is the field of `SlopeEstimate`, column of the session file and of the tables of all minutes; `unit`
    as in CF conventions, "1" for a ratio; `heading` the column of exported tables, with the unit. `pair` is
    the key of ``--json`` under which the ends of a range stand as a list, `short` the heading in tables for
    people, with `digits` decimals: "" for none. `unknown` is the value where nothing is known.
    """

    key: str
    unit: str
    description: str
    unknown: float
    heading: str
    pair: str = ""
    short: str = ""
    digits: int = 1


def _number(description: str, unit: str = "degree", *, unknown: float = NAN, **about: str | int) -> Any:
    """A field of `SlopeEstimate`; `about` are those of its `SlopeField` that are not as usual."""
    metadata = {"description": description, "unit": unit, "unknown": unknown, **about}
    return field(default=unknown, metadata=metadata)


@dataclass(frozen=True, slots=True)
class SlopeEstimate:
    """Slope of one region from the minute bins `window_start_ns`..`time_ns`.

    Angles in degrees, NaN where not determined; bounds are the projections of the likelihood region with
    noise and the stated systematic uncertainties, the `noise_` bounds those of noise alone. The half-width of
    a tilt follows from its bounds where none is given. Azimuth bounds
    are unwrapped (low <= azimuth <= high, so below 0 or above 360 across north). `reason` explains in words
    why the state is not `OK`. Every number is described where it stands, and with that a column of every
    table (`SLOPE_FIELDS`).
    """

    time_ns: int
    region: str
    state: SlopeState
    tilt_deg: float = _number("tilt from horizontal")
    azimuth_deg: float = _number("azimuth of the normal from north, clockwise")
    tilt_low_deg: float = _number("lower end of the likelihood region of the tilt", pair="tilt_region_deg")
    tilt_high_deg: float = _number("upper end of the likelihood region of the tilt", pair="tilt_region_deg")
    azimuth_low_deg: float = _number(
        "lower end of the likelihood region of the azimuth", pair="azimuth_region_deg"
    )
    azimuth_high_deg: float = _number(
        "upper end of the likelihood region of the azimuth", pair="azimuth_region_deg"
    )
    second_tilt_deg: float = _number("tilt of another slope that fits as well")
    second_azimuth_deg: float = _number("azimuth of another slope that fits as well")
    kelvin_per_degree: float = _number(
        "change of the surface temperature per degree of tilt",
        "K degree-1",
        heading="sensitivity [K/deg]",
        short="K per °",
        digits=2,
    )
    chi_square: float = _number("reduced chi-square", "1", heading="chi-square", short="chi²")
    flags: Quality = Quality.GOOD
    window_start_ns: int = 0
    n_bins: int = 0
    model: str = ""
    reason: str = ""
    tilt_half_width_deg: float = _number(
        "half the width of the likelihood region of the tilt, before it is cut at 0"
    )
    noise_tilt_low_deg: float = _number(
        "lower end of the region of the tilt by noise alone", pair="tilt_noise_region_deg"
    )
    noise_tilt_high_deg: float = _number(
        "upper end of the region of the tilt by noise alone", pair="tilt_noise_region_deg"
    )
    noise_azimuth_low_deg: float = _number(
        "lower end of the region of the azimuth by noise alone", pair="azimuth_noise_region_deg"
    )
    noise_azimuth_high_deg: float = _number(
        "upper end of the region of the azimuth by noise alone", pair="azimuth_noise_region_deg"
    )
    confidence: float = _number(
        "probability with which the regions should hold the truth",
        "1",
        heading="confidence",
        unknown=CONFIDENCE,
    )
    along_sun_deg: float = _number("tilt towards the sun's azimuth, where too few minutes give no more")
    along_sun_low_deg: float = _number(
        "lower end of the likelihood region of the tilt towards the sun", pair="along_sun_region_deg"
    )
    along_sun_high_deg: float = _number(
        "upper end of the likelihood region of the tilt towards the sun", pair="along_sun_region_deg"
    )
    sun_azimuth_deg: float = _number("azimuth that `along_sun_deg` is the tilt towards")
    east_deg: float = _number("by how much the normal leans to the east, from the weather alone")
    east_low_deg: float = _number("lower end of its interval", pair="east_region_deg")
    east_high_deg: float = _number("upper end of its interval", pair="east_region_deg")
    north_deg: float = _number("by how much the normal leans to the north, from the weather alone")
    north_low_deg: float = _number("lower end of its interval", pair="north_region_deg")
    north_high_deg: float = _number("upper end of its interval", pair="north_region_deg")

    def __post_init__(self) -> None:
        if math.isnan(self.tilt_half_width_deg):
            half = half_width_deg(self.tilt_deg, self.tilt_low_deg, self.tilt_high_deg)
            object.__setattr__(self, "tilt_half_width_deg", float(half))

    def __repr__(self) -> str:
        tilt = f"tilt {self.tilt_deg:.1f}° ({self.tilt_low_deg:.1f} to {self.tilt_high_deg:.1f})"
        second = f", or {self.second_tilt_deg:.1f}°" if math.isfinite(self.second_tilt_deg) else ""
        return f"<{self.region}: {tilt}{second}, azimuth {self.azimuth_deg:.0f}°, {self.state.name.lower()}>"


def _field(key: str, about: Mapping[str, Any]) -> SlopeField:
    plain = f"{key.removesuffix('_deg').replace('_', ' ')} [deg]"
    return SlopeField(key, **{"heading": plain, **about})


SLOPE_FIELDS: Mapping[str, SlopeField] = MappingProxyType(
    {field.name: _field(field.name, field.metadata) for field in fields(SlopeEstimate) if field.metadata}
)
"""The numbers of a slope by key, in the order of `SlopeEstimate`."""
SHORT_FIELDS = tuple(field for field in SLOPE_FIELDS.values() if field.short)
"""Those with a column of their own in tables for people."""


def final_rows(regions: Iterable[K], has_slope: Sequence[bool]) -> dict[K, int]:
    """Row of each region's final estimate: its last row with a slope, else its last one.

    `regions` and `has_slope` are of estimates (n,) in order of time.
    """
    rows: dict[K, int] = {}
    for row, region in enumerate(regions):
        if has_slope[row] or not has_slope[rows.get(region, row)]:
            rows[region] = row
    return rows


@dataclass(frozen=True, slots=True)
class ReferenceCheck:
    """Slope of a reference as all other regions show it, with its likelihood region, beside the stated one.

    `holds` unless the two contradict each other. Angles in degrees.
    """

    region: str
    stated_tilt_deg: float
    tilt_deg: float
    tilt_low_deg: float
    tilt_high_deg: float
    holds: bool


def final_estimates(
    estimates: Iterable[SlopeEstimate], regions: Sequence[Region]
) -> dict[str, SlopeEstimate]:
    """The final estimate of each target that was estimated, in the order of the regions."""
    in_order = list(estimates)
    states = [estimate.state in WITH_SLOPE for estimate in in_order]
    rows = final_rows((estimate.region for estimate in in_order), states)
    targets = [region.name for region in regions if region.kind is RegionKind.TARGET]
    return {name: in_order[rows[name]] for name in targets if name in rows}
