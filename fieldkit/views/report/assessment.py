"""The assessment of a session: which slopes were found, how accurate they are, and the warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.model.alarm import Phase, phase_of, present_alarms
from fieldkit.model.samples import Event, EventKind
from fieldkit.model.slope import CERTAIN, SlopeEstimate, SlopeState, is_certain
from fieldkit.views import formatting
from fieldkit.views.report.series import Series, TargetSeries

_COUNTED = {
    EventKind.LOST: ("device lost", "devices lost"),
    EventKind.GAP: ("gap", "gaps"),
    EventKind.FROZEN: ("frozen image", "frozen images"),
    EventKind.GARBLED: ("report of garbled records", "reports of garbled records"),
    EventKind.OVERRANGE: ("reading out of range", "readings out of range"),
    EventKind.CLOCK_STEP: ("clock step", "clock steps"),
    EventKind.SLEPT: ("suspend of the computer", "suspends of the computer"),
    EventKind.MOVED: ("movement of the camera", "movements of the camera"),
    EventKind.DISK: ("disk warning", "disk warnings"),
}


@dataclass(frozen=True, slots=True)
class Assessment:
    """One sentence on the slopes, and the warnings one by one."""

    headline: str
    warnings: tuple[str, ...]


def assess(columns: Series, events: Sequence[Event], state: str) -> Assessment:
    """Assess the minutes and events of a session in `state`."""
    return Assessment(_headline(columns), (*_slope_warnings(columns), *_recording_warnings(events, state)))


def mean_error(columns: Series) -> float:
    """Mean over the targets of their mean absolute tilt error, degrees; NaN where none is known."""
    errors = [target.mean_error_deg for target in columns.targets if np.isfinite(target.mean_error_deg)]
    return float(np.mean(errors)) if errors else float("nan")


def truths_held(columns: Series) -> str:
    """Share of the final likelihood regions that hold the given tilt, in words; empty if none was given."""
    finals = [(target.final_estimate, target.region.tilt_deg) for target in columns.targets]
    with_truth = [(estimate, truth) for estimate, truth in finals if estimate and truth == truth]
    count = sum(estimate.tilt_low_deg <= truth <= estimate.tilt_high_deg for estimate, truth in with_truth)
    sure = formatting.confidence(estimate for estimate, _ in with_truth)
    return (
        f"The given tilt is within the {sure} region on {_of(count, len(with_truth))}." if with_truth else ""
    )


def _headline(columns: Series) -> str:
    estimated = [target for target in columns.targets if target.final_estimate is not None]
    certain = [target for target in estimated if target.final_estimate and is_certain(target.final_estimate)]
    if not columns.targets:
        return "No target regions are drawn: nothing was estimated."
    if not estimated:
        return f"No slope was found on any of {len(columns.targets)} targets."
    off = {target.region.name: error for target in estimated if np.isfinite(error := _final_error(target))}
    if certain and len(off) == len(columns.targets) and all(map(_is_held, estimated)):
        sentence = _all_held([target.final_estimate for target in estimated if target.final_estimate])
    else:
        sentence = _certain_sentence(len(certain), len(columns.targets))
        if wide := [target for target in estimated if target not in certain]:
            sentence += f" Wide: {', '.join(map(_with_second_branch, wide))}."
        sentence = f"{sentence} {truths_held(columns)}".strip()
    if not off:
        return f"{sentence} No true tilts were given to compare with."
    worst = max(off, key=lambda name: off[name])
    return f"{sentence} The largest error has {worst}: {off[worst]:.1f}°."


def _final_error(target: TargetSeries) -> float:
    """Absolute difference of the final tilt to the given one, degrees; NaN if it was not given."""
    return (
        abs(target.final_estimate.tilt_deg - target.region.tilt_deg)
        if target.final_estimate
        else float("nan")
    )


def _is_held(target: TargetSeries) -> bool:
    """True if the given tilt lies within the region of the final estimate, which a single slope fits."""
    final, truth = target.final_estimate, target.region.tilt_deg
    is_single = final is not None and final.state is not SlopeState.NOT_RESOLVED
    return bool(is_single and final and final.tilt_low_deg <= truth <= final.tilt_high_deg)


def _all_held(finals: Sequence[SlopeEstimate]) -> str:
    """That all are right, and the widest region."""
    widths = {final.region: formatting.half_region(final) for final in finals}
    widest = max(widths, key=lambda name: widths[name])
    some = {1: "The slope was", 2: "Both slopes were"}
    every = some.get(len(finals), f"All {len(finals)} slopes were")
    return (
        f"{every} found, ±{widths[widest]:.1f}° at most ({widest}): every given tilt is within its "
        f"{formatting.confidence(finals)} region."
    )


def _certain_sentence(certain: int, total: int) -> str:
    if not certain:
        return "No slope is certain."
    return f"Slopes were found on {_of(certain, total)}."


def _with_second_branch(target: TargetSeries) -> str:
    final = target.final_estimate
    assert final is not None
    second = formatting.second_branch(final)
    return f"{target.region.name} {formatting.tilt(final)}°" + (f" or {second}" if second else "")


def _of(some: int, total: int) -> str:
    if total == 1:
        return "the target" if some else "0 of 1 targets"
    return f"all {total} targets" if some == total else f"{some} of {total} targets"


def _slope_warnings(columns: Series) -> list[str]:
    warnings = []
    for target in columns.targets:
        last = target.last
        if last is not None and last.state not in CERTAIN:
            reasons = (f" {word[0].upper()}{word[1:]}." for word in last.reason.split("; ") if word)
            warnings.append(f"{target.region.name} ended as: {formatting.state(last)}.{''.join(reasons)}")
    minutes = int(columns.cloudy.sum())
    if minutes:
        warnings.append(f"Clouds or changing light in {minutes} of {columns.time_ns.size} minutes.")
    return warnings


def _recording_warnings(events: Sequence[Event], state: str) -> list[str]:
    warnings = []
    if state not in ("sealed", "recovered"):
        warnings.append(f"The session is {state}, not sealed: more may follow, or recover it.")
    for kind, (singular, many) in _COUNTED.items():
        count = sum(event.kind is kind for event in events)
        if count:
            warnings.append(f"{count} {singular if count == 1 else many} while recording; see Events.")
    return warnings + _alarm_warnings(events)


def _alarm_warnings(events: Sequence[Event]) -> list[str]:
    """Number of alarms raised, and those still present."""
    raised = sum(phase_of(event) is Phase.RAISED for event in events)
    warnings = [f"{raised} {'alarm' if raised == 1 else 'alarms'} while recording; see Events."] * (
        raised > 0
    )
    if left := present_alarms(events):
        warnings.append(f"Present at the end: {'; '.join(alarm.text for alarm in left)}.")
    return warnings
