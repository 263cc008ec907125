"""Check a session: what the file shows by itself, and whether its samples still give the stored estimates."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.ground.horizon_check import horizon_findings
from fieldkit.model.errors import RefusedError, message_of
from fieldkit.model.finding import Finding, worst
from fieldkit.model.slope import SlopeEstimate
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.sources import SessionOrFile, config_for, path_of
from fieldkit.sessions import check as file_check
from fieldkit.sessions.finished_file import apply_time_map, propose_time_map
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.sessions.time_map import TimeStep
from fieldkit.views import html

if TYPE_CHECKING:
    import pandas as pd

SAME_DEG = 1e-6
"""Difference that another processor's rounding can make; nobody could tell it from none."""


@dataclass(frozen=True)
class CheckedSession:
    """The findings about a session file, each with what to do next."""

    path: Path
    findings: tuple[Finding, ...]

    @property
    def level(self) -> str:
        """The worst level among the findings: ``ok``, ``warn`` or ``fail``."""
        return worst(self.findings)

    def __repr__(self) -> str:
        counts = Counter(one.level for one in self.findings)
        return (
            f"<CheckedSession {self.path.stem}: {', '.join(f'{n} {level}' for level, n in counts.items())}>"
        )

    def _repr_html_(self) -> str:
        rows = [(one.level, one.what, one.text, one.fix) for one in self.findings]
        return html.table_html(html.Table(("", "about", "finding", "fix"), rows, str(self.path)))

    def to_frame(self) -> pd.DataFrame:
        """The findings, one row each."""
        import pandas as pd

        return pd.DataFrame(self.findings)


def check(session: SessionOrFile, *, estimates: bool = True) -> CheckedSession:
    """Check a session or its file: checksums, gaps, rates, clocks, units, and with `estimates` the slopes.

    Slopes are estimated again from the stored samples and compared with those the recording stored, unless
    this version recorded them with these settings on this computer. Nothing is changed. What is wrong is a
    finding; nothing is raised for it.

    Examples
    --------
    >>> checked = fieldkit.check(session)
    >>> checked.level
    'ok'
    >>> checked.findings[0].text
    'sealed: every sample was compared with the journal'
    """
    path = path_of(session)
    findings = file_check.check(path)
    if estimates and not any(one.what == "file" for one in findings):
        with open_session(path) as opened:
            findings += _estimate_findings(opened)
    return CheckedSession(path, tuple(findings))


def _estimate_findings(session: SessionReader) -> list[Finding]:
    """The estimates of the recording against those that the same samples give now."""
    try:
        return _compared(session)
    except Exception as error:  # whatever is in the file
        fix = getattr(error, "fix", None) or ""
        return [Finding("warn", "slopes", f"could not be computed again: {message_of(error)}", fix)]


def _compared(session: SessionReader) -> list[Finding]:
    stored = session.estimates()
    if not stored or session.time_map() or session.has_corrected_marks:
        return []
    known = _minutes(session)
    minutes = known.minutes()
    computed = {_key(one): one for minute in minutes for one in minute.estimates}
    shadows = list(horizon_findings(minutes, session.regions, config_for(session).estimator_settings()))
    differing = sum(not _is_same(one, computed.get(_key(one))) for one in stored)
    if differing:
        text = f"{differing} of {len(stored)} slopes come out differently from the stored samples"
        fix = "another version of fieldkit, or samples that were lost"
        return [Finding("warn", "slopes", text, fix), *shadows]
    text = f"{len(stored)} slopes come out the same from the stored samples"
    if known.measured.is_recordings:
        text = f"{len(stored)} slopes are the recording's own, by this version and these settings"
    return [Finding("ok", "slopes", text), *shadows]


def _minutes(session: SessionReader) -> SessionMinutes:
    # streams that were imported later had no part in what the recording estimated
    recorded = tuple(info for info in session.streams.values() if info.driver != "import")
    return SessionMinutes(session, config_for(session), streams=recorded)


def _key(estimate: SlopeEstimate) -> tuple[int, str]:
    return estimate.time_ns // 1000, estimate.region  # times are stored to the microsecond


def _is_same(stored: SlopeEstimate, other: SlopeEstimate | None) -> bool:
    return (
        other is not None
        and _is_close(stored.tilt_deg, other.tilt_deg)
        and _is_close(stored.azimuth_deg, other.azimuth_deg)
    )


def _is_close(one: float, other: float) -> bool:
    return abs(one - other) <= SAME_DEG or (one != one and other != other)


def correct_clock(path: str | Path) -> tuple[TimeStep, ...]:
    """Write the time map that a session's clock comparisons propose into it, as data; its steps.

    Recorded times stay as they are. No steps are returned if the map is active already. Raises
    `RefusedError` if the comparisons call for no correction.
    """
    path = Path(path)
    with open_session(path) as session:
        steps = propose_time_map(session)
        if not steps:
            raise RefusedError(f"{path.name}: its clock comparisons call for no correction")
        if steps == session.time_map():
            return ()
    apply_time_map(path, steps)
    return tuple(steps)
