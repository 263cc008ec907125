"""Offsets between regions from a uniform target in view of all of them, before and after a session.

The slope method uses differences between regions, and averaging does not remove a constant one. A target of
uniform temperature over all regions (cardboard in the shade, a lid) shows it. Offsets are brightness
temperatures of a region less that of the reference; kelvin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fieldkit.calibration.uncertainty import Contribution, combined_uncertainty
from fieldkit.model.errors import CalibrationError
from fieldkit.model.units import HOUR_NS

MAX_OFFSET_K = 3.0
"""Larger than differences between pixels of a camera: the regions did not view one target."""
STEADY_K = 0.3
"""Largest drift of regions against each other during one view."""


@dataclass(frozen=True, slots=True)
class TargetView:
    """Offsets of regions and their standard errors from one view of the target; `time_ns` is its middle.

    `change_k` is how far a region drifted against the reference during the view.
    """

    time_ns: int
    offset_k: Mapping[str, float]
    offset_sd_k: Mapping[str, float]
    change_k: float = 0.0


@dataclass(frozen=True, slots=True)
class Uniformity:
    """Offsets to use, their budgets, and their drift between two views (NaN after one)."""

    offset_k: Mapping[str, float]
    budget: Mapping[str, tuple[Contribution, ...]]
    drift_k_per_h: Mapping[str, float]

    def standard_uncertainty_k(self, region: str) -> float:
        """Standard uncertainty of one region's offset."""
        return combined_uncertainty(self.budget[region])

    @property
    def worst(self) -> str:
        """The region whose offset has the largest uncertainty."""
        return max(self.budget, key=self.standard_uncertainty_k)


def uniformity(
    before: TargetView, after: TargetView | None = None, *, target_sd_k: float = 0.05
) -> Uniformity:
    """Offsets by region, with budgets and drifts, from one view of the target or the mean of two.

    Half the change between two views is a bound for the time between; `target_sd_k` is the standard
    uncertainty of the target's own uniformity. Raises `CalibrationError` if the regions cannot have viewed
    one uniform target.
    """
    views = [before] if after is None else sorted((before, after), key=lambda view: view.time_ns)
    _refuse_no_target(views)
    hours = (views[-1].time_ns - views[0].time_ns) / HOUR_NS
    regions = list(before.offset_k)
    change = {name: views[-1].offset_k[name] - views[0].offset_k[name] for name in regions}
    return Uniformity(
        {name: sum(view.offset_k[name] for view in views) / len(views) for name in regions},
        {name: tuple(_budget(name, views, change[name], target_sd_k)) for name in regions},
        {name: change[name] / hours if hours > 0.0 else math.nan for name in regions},
    )


def _refuse_no_target(views: list[TargetView]) -> None:
    for view in views:
        for name, offset in view.offset_k.items():
            if not abs(offset) <= MAX_OFFSET_K:
                raise CalibrationError(
                    f"differs from the reference by {offset:+.1f} K: they did not view one target",
                    place=name,
                    fix="put one board over all regions, in the shade, and let it settle for ten minutes",
                )
        if view.change_k > STEADY_K:
            raise CalibrationError(
                f"the regions drift apart by {view.change_k:.1f} K in one view: the target is not uniform",
                fix="let the board settle for ten minutes in the shade, and keep hands and sun off it",
            )
    if len(views) == 2 and views[0].time_ns == views[1].time_ns:
        raise CalibrationError(
            "before and after are of one time: they are the same recording",
            fix="give a second recording of the board, or the first alone",
        )
    if any(view.offset_k.keys() != views[0].offset_k.keys() for view in views):
        raise CalibrationError(
            "the regions before and after are not the same", fix="take both views with the same regions"
        )


def _budget(name: str, views: list[TargetView], change_k: float, target_sd_k: float) -> list[Contribution]:
    scatter = math.hypot(*(view.offset_sd_k[name] for view in views)) / len(views)
    lines = [
        Contribution("scatter", scatter, "K", "A", scatter),
        Contribution("target not uniform", target_sd_k, "K", "B", target_sd_k),
    ]
    if len(views) == 2:  # anywhere between the two, rectangular
        between = abs(change_k) / 2.0 / math.sqrt(3.0)
        lines.append(Contribution("drift between the looks", between, "K", "B", between))
    return lines
