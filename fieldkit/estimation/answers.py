"""Which estimate stands for a region over a whole session: one rule for every table, page and verb."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState, is_too_wide

CERTAIN = (SlopeState.OK, SlopeState.FLAT)
"""States of a slope that may be relied on as it stands."""
WORKED_OUT = (*CERTAIN, SlopeState.UNCERTAIN, SlopeState.NOT_RESOLVED)
"""States whose slope was worked out at that very minute; only these count in mean errors."""
ANSWERED = (*WORKED_OUT, SlopeState.HELD_CLOUD)
"""States that say a slope: a held one is an earlier answer."""


def is_certain(estimate: SlopeEstimate) -> bool:
    """Whether a slope may be relied on, now or held over a cloud: one alone fits, within a narrow region."""
    says_one = estimate.state in (*CERTAIN, SlopeState.HELD_CLOUD) and not math.isfinite(
        estimate.second_tilt_deg
    )
    return says_one and not is_too_wide(estimate.tilt_deg, estimate.tilt_low_deg, estimate.tilt_high_deg)


def answer_of(estimates: Iterable[SlopeEstimate]) -> SlopeEstimate | None:
    """The last estimate of one region, in order of time, that says a slope; else the last one."""
    answer: SlopeEstimate | None = None
    for estimate in estimates:
        if answer is None or estimate.state in ANSWERED or answer.state not in ANSWERED:
            answer = estimate
    return answer


def answers_of(estimates: Iterable[SlopeEstimate], regions: Sequence[Region]) -> dict[str, SlopeEstimate]:
    """The answer of each target that was estimated, in the order of the regions."""
    targets = [region.name for region in regions if region.kind is RegionKind.TARGET]
    told: dict[str, list[SlopeEstimate]] = {name: [] for name in targets}
    for estimate in estimates:
        told.setdefault(estimate.region, []).append(estimate)
    answers = {name: answer_of(told[name]) for name in targets}
    return {name: answer for name, answer in answers.items() if answer is not None}
