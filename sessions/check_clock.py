"""Checking the clocks of a session, and proposing and writing its time map."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from fieldkit.clock import ClockCheck
from fieldkit.errors import SessionError
from fieldkit.sessions.disk import sync
from fieldkit.sessions.findings import Finding
from fieldkit.sessions.guarded import GuardedFile
from fieldkit.sessions.layout import encode_text
from fieldkit.sessions.reader import Session, open_session
from fieldkit.sessions.time_map import TimeStep

STEP_NS = 1_000_000_000
TOLERANCE_NS = 2_000_000_000
_TRUSTED = ("gps", "ptp", "ntp", "phone")


def clock_findings(session: Session) -> Iterator[Finding]:
    """Steps and drift of the system clock against the monotonic one, sleep, and the map in force."""
    checks = session.clock_checks()
    offsets = np.array([check.utc_minus_mono_ns for check in checks], np.int64)
    if checks:
        steps = np.flatnonzero(np.abs(np.diff(offsets)) > STEP_NS)
        for n in steps:
            by_s = (int(offsets[n + 1]) - int(offsets[n])) / 1e9
            yield Finding(
                "warn", "clock", f"the system clock was stepped by {by_s:+.3f} s; recorded times go on"
            )
        drift_s = (int(offsets[-1]) - session.anchor_ns) / 1e9
        level = "ok" if abs(drift_s) < 2.0 else "warn"
        text = (
            f"{len(checks)} comparisons; at the end the system clock was {drift_s:+.3f} s from recorded times"
        )
        fix = f"fieldkit check --apply {session.path}" if level == "warn" else ""
        yield Finding(level, "clock", text, fix)
        slept_s = (checks[-1].suspended_ns - checks[0].suspended_ns) / 1e9
        if slept_s > 1.0:
            yield Finding(
                "warn", "clock", f"the computer slept {slept_s:.0f} s: its times after that are late"
            )
    else:
        yield Finding("ok", "clock", "the clocks were not compared while recording")
    if steps_in_force := session.time_map():
        text = "; ".join(f"{step.add_ns / 1e9:+.3f} s ({step.reason})" for step in steps_in_force)
        yield Finding("ok", "clock", f"a time map is in force: {text}")


def propose_time_map(session: Session) -> list[TimeStep]:
    """What should be added to the recorded times, by the clock comparisons; empty where nothing must be.

    A comparison with a trusted source (GPS, NTP ...) counts for the whole session; otherwise
    the last one does if the system clock was stepped, because clocks are stepped to be right.
    """
    checks = session.clock_checks()
    if not checks:
        return []
    trusted = [check for check in checks if check.source in _TRUSTED]
    best = min(trusted, key=lambda check: check.error_ns) if trusted else _after_last_step(checks)
    if best is None or abs(add := best.utc_minus_mono_ns - session.anchor_ns) < TOLERANCE_NS:
        return _asleep(checks)
    return [TimeStep(0, add, f"clock comparison, source {best.source}")]


def _after_last_step(checks: Sequence[ClockCheck]) -> ClockCheck | None:
    offsets = np.array([check.utc_minus_mono_ns for check in checks], np.int64)
    return checks[-1] if (np.abs(np.diff(offsets)) > STEP_NS).any() else None


def _asleep(checks: Sequence[ClockCheck]) -> list[TimeStep]:
    """Sleep stops the monotonic clock: what came after it needs the time slept."""
    steps, slept = [], 0
    for before, after in pairwise(checks):
        more = after.suspended_ns - before.suspended_ns
        if more > STEP_NS:
            slept += more
            steps.append(TimeStep(before.mono_ns, slept, f"the computer slept {more / 1e9:.0f} s"))
    return steps


def apply_time_map(path: Path, steps: Sequence[TimeStep]) -> None:
    """Write a time map into a finished session, as a new version beside those before.

    Raises `SessionError` where the session is not finished.
    """
    with open_session(path) as session:
        if session.state not in ("sealed", "recovered"):
            raise SessionError(f"{path} is {session.state}", fix=f"fieldkit recover {path}")
    with GuardedFile(path) as file:
        group = file["time_map"]
        old = group["time"].shape[0]
        version = int(group["version"][:].max(initial=0)) + 1
        rows = {
            "mono_ns": [step.mono_ns for step in steps],
            "add_ns": [step.add_ns for step in steps],
            "version": [version] * len(steps),
            "reason": [encode_text(step.reason, 256) for step in steps],
            "time": [time.time_ns() // 1000] * len(steps),
        }
        for name, values in rows.items():
            group[name].resize((old + len(steps),))
            group[name][old:] = values
    sync(path)
