"""The report of several sessions together: errors by target and day, the paper's Figs. 12 and 13 over all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldkit.disk import sha256
from fieldkit.estimation import statistics
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.statistics import ErrorSpan, SdKind
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Site
from fieldkit.phrases import counted
from fieldkit.views import formatting, plotting
from fieldkit.views.html import Figure, Table, code, render, strong
from fieldkit.views.report import session_figures
from fieldkit.views.report.error_budget import READING, budget, cause_rows, pool
from fieldkit.views.report.recording import versions
from fieldkit.views.report.results import SPAN_S, paper_figures, sd_words
from fieldkit.views.report.series import Series, TargetSeries, modelled_temperature
from fieldkit.views.report.session_figures import FinalTilt


@dataclass(frozen=True)
class Part:
    """One session of a campaign, estimated, with the warnings of its own report."""

    path: Path
    site: Site
    columns: Series
    settings: EstimatorSettings
    warnings: Sequence[str] = ()
    simulated: bool = False

    @property
    def day(self) -> str:
        """The local date, and the file's own name where there is no minute."""
        if not self.columns.time_ns.size:
            return self.path.stem
        return formatting.local_time(int(self.columns.time_ns[0]), self.site).strftime("%Y-%m-%d")


def write_campaign_report(
    path: Path, title: str, parts: Sequence[Part], *, sd: SdKind = "paper", command_line: str = ""
) -> None:
    """Write one HTML file on several sessions (at least one).

    Raises `OSError` if the file cannot be written.
    """
    page = render(
        "campaign_report.html",
        title=title,
        session_count=len(parts),
        headline=_headline(parts),
        simulated=sum(part.simulated for part in parts),
        warnings=[(part.path.stem, part.warnings) for part in parts if part.warnings],
        slopes=_slope_figures(parts) if plotting.available() else None,
        targets=_targets(parts, sd),
        comparison=_comparison(parts, sd) if plotting.available() else None,
        budget=_error_budget(parts),
        sessions=Table(("session", "SHA-256"), [(part.path.name, code(sha256(part.path))) for part in parts]),
        provenance=_provenance(command_line),
    )
    path.write_text(page, encoding="utf-8")


def _headline(parts: Sequence[Part]) -> str:
    targets = [target for part in parts for target in part.columns.targets]
    errors = [target.estimated_tilt_deg - target.region.tilt_deg for target in targets]
    error = np.concatenate([np.empty(0), *errors])
    mean = statistics.mean_absolute_error(error, 0.0)
    if not np.isfinite(mean):
        return "No slope of a region of known tilt was found in these sessions."
    count = int(np.isfinite(error).sum())
    mean_words = f"Mean absolute tilt error {mean:.1f}° over {counted(count, 'estimate')}"
    wide = sum(target.wide for target in targets)
    meaning = formatting.wide_means(_confidence(parts), parts[0].settings.target_half_width_deg)
    return f"{mean_words}, of which {wide} are wide ({meaning})."


def _confidence(parts: Sequence[Part]) -> str:
    """Confidence of the final estimates in words; "likelihood" where there are none."""
    finals = (target.final_estimate for part in parts for target in part.columns.targets)
    return formatting.confidence(final for final in finals if final) or "likelihood"


def _targets(parts: Sequence[Part], sd: SdKind) -> Table:
    rows = [_row(part, target, sd) for part in parts for target in part.columns.targets]
    sure = _confidence(parts)
    caption = (
        f"Tilt: the final one; {formatting.region_words(sure)}. MAE and SD: over the n minutes with an "
        f"estimate; SD {sd_words(sd)}. Wide: how many of them are. RMSE: measured surface temperature "
        "against eq. (7), the reference standing in for air and sky."
    )
    errors = ("MAE (SD) °", "n", "wide", "RMSE K", "cloudy min")
    return Table(("day", "session", "region", "tilt °", "given", *errors), rows, caption)


def _row(part: Part, target: TargetSeries, sd: SdKind) -> list[object]:
    modelled = modelled_temperature(part.columns, target, part.settings.surface)
    rmse = statistics.root_mean_square_error(part.columns.temperature_k[target.region.name], modelled)
    return [
        part.day,
        part.path.stem,
        strong(target.region.name),
        target.final_words,
        formatting.given_slope(target.region),
        target.error_words(sd),
        int(np.isfinite(target.estimated_tilt_deg).sum()),
        target.wide,
        formatting.number(rmse, 2),
        int(part.columns.cloudy.sum()),
    ]


def _slope_figures(parts: Sequence[Part]) -> list[Figure]:
    """The final tilts of all sessions; none where no slope was found."""
    tilts = [
        FinalTilt(part.path.stem, final, target.region.tilt_deg)
        for part in parts
        for target in part.columns.targets
        if (final := target.final_estimate)
    ]
    if not tilts:
        return []
    words = "; ".join(f"{session} {target.region} {target.tilt_deg:.1f}°" for session, target, _ in tilts)
    targets = list(dict.fromkeys(tilt.estimate.region for tilt in tilts))
    return [
        Figure(
            session_figures.final_tilts(tilts),
            f"Final tilt of each region by session, in order of time. Bars: {_confidence(parts)} region; "
            "lines: the given tilts.",
            f"Final tilts: {words}.",
            parts=targets,
        )
    ]


def _comparison(parts: Sequence[Part], sd: SdKind) -> list[Figure]:
    """The paper's figures with one colour per day, and one line per given tilt."""
    return list(paper_figures(*_temperatures(parts), _errors_by_tilt(parts, sd), _zone(parts[0]), sd))


def _errors_by_tilt(parts: Sequence[Part], sd: SdKind) -> dict[str, list[ErrorSpan]]:
    """Errors per interval of the local day for each given tilt, all days and targets of it together."""
    rows = {}
    for tilt, targets in _by_tilt(parts).items():
        times_ns = np.concatenate([part.columns.of_day_ns(part.site) for part, _ in targets])
        tilts_deg = np.concatenate([target.estimated_tilt_deg for _, target in targets])
        rows[f"{tilt:g}°"] = statistics.errors_over_time(times_ns, tilts_deg, tilt, span_s=SPAN_S, kind=sd)
    return rows


def _by_tilt(parts: Sequence[Part]) -> dict[float, list[tuple[Part, TargetSeries]]]:
    """The targets of each given tilt, of all sessions together."""
    by_tilt: dict[float, list[tuple[Part, TargetSeries]]] = {}
    for part in parts:
        for target in part.columns.targets:
            if np.isfinite(target.region.tilt_deg):
                by_tilt.setdefault(target.region.tilt_deg, []).append((part, target))
    return dict(sorted(by_tilt.items()))


def _error_budget(parts: Sequence[Part]) -> Table | None:
    """Cost of each cause for regions of each given tilt, all days together."""
    by_tilt = [
        pool(f"{tilt:g}°", [budget(part.columns, target, part.settings) for part, target in targets])
        for tilt, targets in _by_tilt(parts).items()
    ]
    if not by_tilt:
        return None
    columns = ("cause", *(budget.name for budget in by_tilt))
    caption = f"Degrees of tilt by given tilt, medians over each session and then over sessions, {READING}"
    return Table(columns, cause_rows(by_tilt), caption)


def _zone(part: Part) -> str:
    times_ns = part.columns.time_ns
    return formatting.zone_name(int(times_ns[0]), part.site) if times_ns.size else "UTC"


def _temperatures(parts: Sequence[Part]) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Measured and modelled surface temperature by day, kelvin, targets one after the other."""
    measured: dict[str, list[FloatArray]] = {}
    modelled: dict[str, list[FloatArray]] = {}
    for part in parts:
        for target in part.columns.targets:
            by_model = modelled_temperature(part.columns, target, part.settings.surface)
            if np.isfinite(by_model).any():
                measured.setdefault(part.day, []).append(part.columns.temperature_k[target.region.name])
                modelled.setdefault(part.day, []).append(by_model)
    return (
        {day: np.concatenate(pieces) for day, pieces in measured.items()},
        {day: np.concatenate(pieces) for day, pieces in modelled.items()},
    )


def _provenance(command_line: str) -> Table:
    rows = [("report by", code(command_line or formatting.UNKNOWN)), ("versions", ", ".join(versions()))]
    return Table(("", ""), rows)
