"""Offsets between regions from a uniform target seen by all of them, before and after a session.

What the slope method feels is the difference between regions, and averaging does not take a constant one
away. A target of one temperature over all regions (cardboard in the shade, a lid) shows it. Offsets are
brightness temperatures, measured minus the reference's; kelvin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fieldkit.calibration.uncertainty import Contribution, combined
from fieldkit.model.errors import CalibrationError

LARGEST_OFFSET_K = 3.0
"""Beyond what cameras do between their pixels: then the regions did not see one target."""
STEADY_K = 0.3
"""How far regions may drift apart during one look."""


@dataclass(frozen=True, slots=True)
class Look:
    """Offsets of regions and their standard errors in one look at the target; `time_ns` is its middle.

    `change_k` is how far a region drifted against the reference during the look.
    """

    time_ns: int
    offset_k: Mapping[str, float]
    offset_sd_k: Mapping[str, float]
    change_k: float = 0.0


@dataclass(frozen=True, slots=True)
class Uniformity:
    """Offsets to use, their budgets, and how they drifted between two looks (NaN after one)."""

    offset_k: Mapping[str, float]
    budget: Mapping[str, tuple[Contribution, ...]]
    drift_k_per_h: Mapping[str, float]

    def standard_uncertainty_k(self, region: str) -> float:
        """Standard uncertainty of one region's offset."""
        return combined(self.budget[region])

    @property
    def worst(self) -> str:
        """The region whose offset is known least well."""
        return max(self.budget, key=self.standard_uncertainty_k)


def uniformity(before: Look, after: Look | None = None, *, target_sd_k: float = 0.05) -> Uniformity:
    """Offsets from one look, or the mean of two with half their change as a bound of what lay between.

    `target_sd_k` is how uniform the target itself was. Raises `CalibrationError` where the regions
    cannot have seen one target.
    """
    looks = [before] if after is None else sorted((before, after), key=lambda look: look.time_ns)
    _refuse_no_target(looks)
    hours = (looks[-1].time_ns - looks[0].time_ns) / 3.6e12
    regions = list(before.offset_k)
    change = {name: looks[-1].offset_k[name] - looks[0].offset_k[name] for name in regions}
    return Uniformity(
        {name: sum(look.offset_k[name] for look in looks) / len(looks) for name in regions},
        {name: tuple(_budget(name, looks, change[name], target_sd_k)) for name in regions},
        {name: change[name] / hours if hours > 0.0 else math.nan for name in regions},
    )


def _refuse_no_target(looks: list[Look]) -> None:
    for look in looks:
        for name, offset in look.offset_k.items():
            if not abs(offset) <= LARGEST_OFFSET_K:
                raise CalibrationError(
                    f"{name} differs from the reference by {offset:+.1f} K: they did not see one target",
                    fix="put one board over all regions, in the shade, and let it settle for ten minutes",
                )
        if look.change_k > STEADY_K:
            raise CalibrationError(
                f"the regions drift apart by {look.change_k:.1f} K in one look: no target of one temperature",
                fix="let the board settle for ten minutes in the shade, and keep hands and sun off it",
            )
    if any(look.offset_k.keys() != looks[0].offset_k.keys() for look in looks):
        raise CalibrationError(
            "the regions before and after are not the same", fix="take both looks with the same regions"
        )


def _budget(name: str, looks: list[Look], change_k: float, target_sd_k: float) -> list[Contribution]:
    scatter = math.hypot(*(look.offset_sd_k[name] for look in looks)) / len(looks)
    lines = [
        Contribution("scatter", scatter, "K", "A", scatter),
        Contribution("target not uniform", target_sd_k, "K", "B", target_sd_k),
    ]
    if len(looks) == 2:  # anywhere between the two, rectangular
        between = abs(change_k) / 2.0 / math.sqrt(3.0)
        lines.append(Contribution("drift between the looks", between, "K", "B", between))
    return lines
