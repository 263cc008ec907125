"""Check a session: what the file shows by itself, and whether its samples still give the stored estimates."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from fieldkit.calibration.calibration_record import CalibrationRecord
from fieldkit.config.load import ignored_keys
from fieldkit.estimation.bins import RegionColumns
from fieldkit.estimation.estimator import Minute
from fieldkit.estimation.learned.inputs import doubtful
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import BoolArray
from fieldkit.model.errors import ConfigError, RefusedError, message_of
from fieldkit.model.finding import Finding, worst
from fieldkit.model.installation import DISTRIBUTION
from fieldkit.model.next_step import Action
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K, MINUTE_NS
from fieldkit.phrases import Words, counted
from fieldkit.physics.facet import normal
from fieldkit.physics.horizon import MINUTE_EDGE_DEG, sunlit_share
from fieldkit.results.batch import BySession, each
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.sources import ONE, SessionOrFile, config_for, path_of
from fieldkit.sessions import check as file_check
from fieldkit.sessions.finished_file import apply_time_map, propose_time_map
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.sessions.time_map import TimeStep
from fieldkit.views import html

if TYPE_CHECKING:
    import pandas as pd

COOLING_MINUTES = 10
"""By then a region in the shadow is several kelvin colder."""
LEAST_FALL_K = 1.0
BRIGHT_W_M2 = 200.0
"""Less direct light leaves no shadow that could be missed."""
CORRECT_MARK = "correct its time or take it back: fieldkit mark --list"
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
        counts = Counter(finding.level for finding in self.findings)
        return (
            f"<CheckedSession {self.path.stem}: {', '.join(f'{n} {level}' for level, n in counts.items())}>"
        )

    def _repr_html_(self) -> str:
        rows = [(finding.level, finding.what, finding.text, str(finding.fix)) for finding in self.findings]
        return html.table_html(html.Table(("", "about", "finding", "fix"), rows, str(self.path)))

    def to_frame(self) -> pd.DataFrame:
        """The findings, one row each."""
        import pandas as pd

        return pd.DataFrame([replace(finding, fix=str(finding.fix)) for finding in self.findings])


@overload
def check(session: SessionOrFile, **options: Any) -> CheckedSession: ...
@overload
def check(session: Sequence[SessionOrFile], **options: Any) -> BySession[CheckedSession]: ...
def check(  # type: ignore[misc]  # the options above are those below
    session: SessionOrFile | Sequence[SessionOrFile],
    *,
    estimates: bool = True,
    executor: Executor | None = None,
) -> CheckedSession | BySession[CheckedSession]:
    """Check a session, its file, or several: checksums, gaps, rates, clocks, units, with `estimates` slopes.

    Of several sessions the checks are returned by file; `executor` is any of `concurrent.futures`, whose
    workers check them, this process unless given.

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
    if not isinstance(session, ONE):
        return each(check, session, executor, estimates=estimates)
    path = path_of(session)
    findings = file_check.check(path)
    if not any(finding.what == "file" for finding in findings):
        with open_session(path) as opened:
            findings += _config_findings(opened)
            findings += _mark_findings(opened)
            findings += _estimate_findings(opened) if estimates else ()
    return CheckedSession(path, tuple(findings))


def _config_findings(session: SessionReader) -> Iterator[Finding]:
    """Keys of the session's configuration that this version does not know, and so does not obey."""
    with contextlib.suppress(ConfigError):  # of an imported session it may be anything
        if keys := ignored_keys(session.config_toml, session.path):
            fix = f"pip install --upgrade {DISTRIBUTION}"
            yield Finding("warn", "config", Words("issue.later_keys", keys=", ".join(keys)), fix)


def _mark_findings(session: SessionReader) -> Iterator[Finding]:
    """Marks outside the recording, which are not used."""
    first, last = session.start_ns // MINUTE_NS, session.end_ns // MINUTE_NS
    for number, mark in session.marks().items():
        if not first <= mark.time_ns // MINUTE_NS <= last:
            text = Words("issue.mark_outside", mark=mark.text)
            yield Finding("warn", f"mark {number}", text, CORRECT_MARK)


def _doubtful_findings(session: SessionReader) -> Iterator[Finding]:
    """Marks of shade that the temperatures contradict."""
    if not any("shade_test" in mark.data for mark in session.marks().values()):
        return
    minutes = _minutes(session)
    columns = RegionColumns(minutes.regions)
    layout = Layout.of(columns, columns.targets, minutes.settings)
    for shade in doubtful(minutes.history, layout, minutes.regions):
        yield Finding("warn", shade.region, Words("issue.doubtful_shade", time=shade.start), CORRECT_MARK)


def _estimate_findings(session: SessionReader) -> list[Finding]:
    """The estimates of the recording against those that the same samples give now."""
    try:
        return [*_compare_estimates(session), *_doubtful_findings(session)]
    except Exception as error:  # whatever is in the file
        fix = getattr(error, "fix", None) or ""
        return [Finding("warn", "slopes", Words("issue.no_estimate", error=message_of(error)), fix)]


def _compare_estimates(session: SessionReader) -> list[Finding]:
    stored_estimates = session.estimates()
    if not stored_estimates or session.time_map() or session.has_corrected_marks:
        return []
    session_minutes = _minutes(session)
    minutes = session_minutes.minutes()
    computed = {_key(estimate): estimate for minute in minutes for estimate in minute.estimates}
    config = config_for(session)
    others = [
        *horizon_findings(minutes, session.regions, config.estimator_settings()),
        *emissivity_findings(minutes, session.regions, config.calibrations()),
    ]
    differing = sum(not _is_same(estimate, computed.get(_key(estimate))) for estimate in stored_estimates)
    if differing:
        text = Words("issue.differing", count=differing, slopes=len(stored_estimates))
        fix = "check for another version of fieldkit, or samples that were lost"
        return [Finding("warn", "slopes", text, fix), *others]
    count = counted(len(stored_estimates), "slope")
    same = f"{count} the same when computed again from the stored samples"
    if session_minutes.measured.is_recordings:
        same = f"{count} of the recording itself, by this version and these settings"
    return [Finding("ok", "slopes", same), *others]


def _minutes(session: SessionReader) -> SessionMinutes:
    # streams that were imported later had no part in what the recording estimated
    recorded = tuple(info for info in session.streams.values() if info.driver != "import")
    return SessionMinutes(session, config_for(session), streams=recorded)


def _key(estimate: SlopeEstimate) -> tuple[int, str]:
    return estimate.time_ns // 1000, estimate.region  # times are stored to the microsecond


def _is_same(stored: SlopeEstimate, other: SlopeEstimate | None) -> bool:
    if other is None:
        return False
    before, now = ((estimate.tilt_deg, estimate.azimuth_deg) for estimate in (stored, other))
    return np.allclose(before, now, rtol=0.0, atol=SAME_DEG, equal_nan=True)


def correct_clock(path: str | Path) -> tuple[TimeStep, ...]:
    """Write the time map that a session's clock comparisons propose into it, as data; its steps.

    Recorded times stay as they are. No steps are returned if the map is active already. Raises
    `RefusedError` if the comparisons call for no correction.
    """
    path = Path(path)
    with open_session(path) as session:
        steps = propose_time_map(session)
        if not steps:
            raise RefusedError("its clock comparisons call for no correction", place=path.name)
        if steps == session.time_map():
            return ()
    apply_time_map(path, steps)
    return tuple(steps)


# --- temperatures of the beds against those at which their emissivity was measured

BEYOND_K = 5.0
"""Judged: steady temperatures of a record are as far apart, so it knows no finer what they change."""


def emissivity_findings(
    minutes: Sequence[Minute], regions: Sequence[Region], records: Mapping[str, CalibrationRecord]
) -> Iterator[Finding]:
    """A warning for each bed more than 5 K colder or warmer than its emissivity's record was made at."""
    for bed in regions:
        record = records.get("surface.emissivity" if np.isnan(bed.emissivity) else f"{bed.name}.emissivity")
        span_c = record.details.get("temperature_range_c") if record else None
        if record is None or span_c is None or bed.kind not in (RegionKind.REFERENCE, RegionKind.TARGET):
            continue
        kelvin = np.array([minute.temperature_k.get(bed.name, np.nan) for minute in minutes])
        celsius = kelvin[np.isfinite(kelvin)] - CELSIUS_ZERO_K
        if celsius.size and (celsius.min() < span_c[0] - BEYOND_K or celsius.max() > span_c[1] + BEYOND_K):
            ends = {"low": span_c[0], "high": span_c[1], "coldest": celsius.min(), "warmest": celsius.max()}
            shown = {name: f"{value:.0f}" for name, value in ends.items()}
            text = Words("issue.emissivity_range", record=record.name, **shown)
            fix = "measure it at these temperatures too: " + Action.CALIBRATE("emissivity")
            yield Finding("warn", bed.name, text, fix)


# --- shadows of a session against the horizons of its regions


def horizon_findings(
    minutes: Sequence[Minute], regions: Sequence[Region], settings: EstimatorSettings
) -> Iterator[Finding]:
    """Contradictions of the horizons, or, without one, minutes that were shaded; a line for each region."""
    if not minutes:
        return
    sun = normal(
        [minute.sun_zenith_deg for minute in minutes], [minute.sun_azimuth_deg for minute in minutes]
    )
    references = [region.name for region in regions if region.kind is RegionKind.REFERENCE]
    # a region in the same shadow as the reference cools with it
    shares = [sunlit_share(settings.horizon_of(name), sun, MINUTE_EDGE_DEG) for name in references]
    compared = np.all(np.array(shares).reshape(-1, len(minutes)) == 1.0, axis=0)
    for region in regions:
        horizon = settings.horizon_of(region.name)
        share = sunlit_share(horizon, sun, MINUTE_EDGE_DEG)
        shaded = _shaded_minutes(minutes, region.name) & (share == 1.0)
        if shaded.any() and horizon:
            text = Words("issue.shaded_above_horizon", times=_times(minutes, shaded))
            yield Finding(
                "warn", region.name, text, "correct its horizon, unless a board or a person was there"
            )
        elif shaded.any():
            fix = "give a horizon and estimate again, if terrain did it; see how-to/shadows"
            yield Finding("warn", region.name, Words("issue.shaded", times=_times(minutes, shaded)), fix)
        below = (share == 0.0) & compared & (sun[:, 2] > 0.0)
        sunlit = _sunlit_below(minutes, region.name, references, below)
        if sunlit.any():
            text = Words("issue.sunlit_below_horizon", times=_times(minutes, sunlit))
            yield Finding("warn", region.name, text, "correct its horizon")


def _shaded_minutes(minutes: Sequence[Minute], region: str) -> BoolArray:
    """Minutes (n,) between the events that report the begin and the end of a shadow."""
    shades, is_shaded = [], False
    for minute in minutes:
        for event in minute.events:
            if event.data.get("shaded") == region:
                is_shaded = event.data.get("phase") == "begin"
        shades.append(is_shaded)
    return np.array(shades, np.bool_)


def _sunlit_below(
    minutes: Sequence[Minute], region: str, references: Sequence[str], below: BoolArray
) -> BoolArray:
    """Minutes (n,) below the horizon in which the region did not become colder against the references."""
    shaded = np.zeros_like(below)
    if region in references or not references:
        return shaded
    over_k = np.array([_over_k(minute, region, references) for minute in minutes])
    for first, last in _runs(below):
        later = first + COOLING_MINUTES
        if first < COOLING_MINUTES or later > last or not minutes[later].dni_w_m2 > BRIGHT_W_M2:
            continue
        if over_k[first - COOLING_MINUTES] - over_k[later] < LEAST_FALL_K:
            shaded[first : last + 1] = True
    return shaded


def _over_k(minute: Minute, region: str, references: Sequence[str]) -> float:
    kelvin = minute.temperature_k
    return kelvin.get(region, np.nan) - float(np.mean([kelvin.get(name, np.nan) for name in references]))


def _runs(condition: BoolArray) -> list[tuple[int, int]]:
    """First and last index of every run in which a condition (n,) holds."""
    edges = np.flatnonzero(np.diff(np.pad(condition.astype(int), 1))).reshape(-1, 2)
    return [(first, end - 1) for first, end in edges.tolist()]


def _times(minutes: Sequence[Minute], chosen: BoolArray) -> str:
    """``18:20-18:59Z, 20:03-20:05Z``."""
    at = [str(np.datetime64(minute.time_ns // 1_000_000_000, "s"))[11:16] for minute in minutes]
    return ", ".join(f"{at[first]}-{at[last]}Z" for first, last in _runs(chosen))
