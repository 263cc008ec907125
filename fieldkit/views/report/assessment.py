"""The assessment of a session: which slopes were found, how accurate they are, and the warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.model.alarm import Phase, phase_of, present_alarms
from fieldkit.model.samples import Event, EventKind
from fieldkit.model.slope import CERTAIN, SlopeState
from fieldkit.phrases import counted
from fieldkit.views import formatting
from fieldkit.views.report.series import Series, TargetSeries

_COUNTED = {
    EventKind.LOST: ("device lost", "devices lost"),
    EventKind.GAP: ("gap", "gaps"),
    EventKind.FROZEN: ("frozen image", "frozen images"),
    EventKind.GARBLED: ("report of garbled records", "reports of garbled records"),
    EventKind.OVERRANGE: ("reading out of range", "readings out of range"),
    EventKind.CLOCK_STEP: ("clock step", "clock steps"),
    EventKind.SLEPT: ("sleep of the computer", "sleeps of the computer"),
    EventKind.MOVED: ("camera movement", "camera movements"),
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
    words = f"Given tilts within their {sure} regions: {count} of {len(with_truth)}."
    return words if with_truth else ""


def _headline(columns: Series) -> str:
    finals = [target.final_estimate for target in columns.targets if target.final_estimate]
    if not columns.targets:
        return "No target regions: nothing to estimate."
    if not finals:
        return f"No slope was found for any of {len(columns.targets)} targets."
    sentence = f"{formatting.findings(finals, columns.regions)}. {truths_held(columns)}".strip()
    errors = {target.region.name: _final_error(target) for target in columns.targets}
    off = {name: error for name, error in errors.items() if np.isfinite(error)}
    if not off:
        return f"{sentence} No given tilts to compare with."
    worst = max(off, key=lambda name: off[name])
    return f"{sentence} Largest error: {off[worst]:.1f}° ({worst})."


def _final_error(target: TargetSeries) -> float:
    """Absolute difference of the final tilt to the given one, degrees; NaN if it was not given."""
    return (
        abs(target.final_estimate.tilt_deg - target.region.tilt_deg)
        if target.final_estimate
        else float("nan")
    )


def _slope_warnings(columns: Series) -> list[str]:
    warnings = []
    for target in columns.targets:
        last = target.last
        if last is not None and (last.state not in CERTAIN or (last.reason and last.state is SlopeState.OK)):
            sentences = [_sentence(reason, columns) for reason in last.reason.split("; ") if reason]
            ended = f"{target.region.name} at the end: {formatting.state(last)}."
            warnings.append(" ".join([ended, *sentences]))
    minutes = int(columns.cloudy.sum())
    if minutes:
        warnings.append(f"Clouds or changing light in {minutes} of {columns.time_ns.size} minutes.")
    return warnings


def _sentence(reason: str, columns: Series) -> str:
    """A reason as a sentence; the name of a region keeps its letters, and a question its mark."""
    is_named = reason.startswith(tuple(f"{region.name} " for region in columns.regions))
    begun = reason if is_named else reason[0].upper() + reason[1:]
    return begun if begun.endswith("?") else f"{begun}."


def _recording_warnings(events: Sequence[Event], state: str) -> list[str]:
    warnings = []
    if state not in ("sealed", "recovered"):
        warnings.append(f"The session is {state}, not sealed: wait for its end, or recover it.")
    for kind, nouns in _COUNTED.items():
        count = sum(event.kind is kind for event in events)
        if count:
            warnings.append(f"{counted(count, *nouns)} while recording; see Events.")
    return warnings + _alarm_warnings(events)


def _alarm_warnings(events: Sequence[Event]) -> list[str]:
    """Number of alarms raised, and those still present."""
    raised = sum(phase_of(event) is Phase.RAISED for event in events)
    warnings = [f"{counted(raised, 'alarm')} while recording; see Events."] * (raised > 0)
    if left := present_alarms(events):
        warnings.append(f"Still present at the end: {'; '.join(alarm.text for alarm in left)}.")
    return warnings
