"""The report of one session: gathers its data and renders the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from fieldkit.estimation.budget import BudgetTerm
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.statistics import SdKind
from fieldkit.model.samples import Frame
from fieldkit.model.site import Region, Site
from fieldkit.views import formatting, plotting
from fieldkit.views.html import render
from fieldkit.views.report import recording, results
from fieldkit.views.report.assessment import assess
from fieldkit.views.report.error_budget import error_budget
from fieldkit.views.report.learnt_section import learnt_section
from fieldkit.views.report.series import ReportData, series

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute
    from fieldkit.sessions.reader import SessionReader

NO_BUDGETS: Mapping[str, tuple[BudgetTerm, ...]] = MappingProxyType({})
LONGEST_LINE = 500
"""Of the configuration, in characters."""


def write_report(
    path: Path,
    session: SessionReader,
    minutes: Sequence[Minute],
    *,
    settings: EstimatorSettings,
    site: Site | None = None,
    regions: Sequence[Region] | None = None,
    sd: SdKind = "paper",
    frame: Frame | None = None,
    others: Mapping[str, Sequence[Minute]] | None = None,
    command_line: str = "",
    config_toml: str | None = None,
    is_recordings: bool = False,
    budgets: Mapping[str, tuple[BudgetTerm, ...]] = NO_BUDGETS,
) -> None:
    """Write the report of a session as one self-contained HTML file into an existing folder.

    `minutes` are the estimator's by `settings`, or the recording's own (`is_recordings`); `site`, `regions`
    and `config_toml` are given where they are not the session's own. `others` are the same samples estimated
    with other surface models, by their names, `budgets` the uncertainty budget of each slope by region,
    `frame` is the one to show, `command_line` what was typed. `sd` is the standard deviation of the absolute
    errors: eq. (9) as printed, or the usual one. Raises `OSError`.
    """
    regions = tuple(session.regions if regions is None else regions)
    data = ReportData(
        session=session,
        site=site or session.site,
        regions=regions,
        columns=series(minutes, regions),
        settings=settings,
        sd=sd,
        events=tuple(formatting.by_time(session.events())),
        frame=frame,
        others={model: series(found, regions) for model, found in (others or {}).items()},
        command_line=command_line,
        config_toml=session.config_toml if config_toml is None else config_toml,
        can_draw=plotting.available(),
        is_recordings=is_recordings,
        budgets=budgets,
    )
    path.write_text(_page(data), encoding="utf-8")


def _page(data: ReportData) -> str:
    return render(
        "session_report.html",
        title=data.session.header.title or data.session.path.stem,
        facts=_facts(data),
        description=data.session.header.description,
        assessment=assess(data.columns, data.events, data.session.state),
        simulated=recording.is_simulated(data.session),
        slopes=results.slopes(data),
        accuracy=results.accuracy(data),
        slope_figures=data.drawn(results.slope_figures),
        caveat=results.caveat(data.settings),
        learnt=learnt_section(data),
        frame=recording.frame_image(data),
        has_camera=any(info.is_camera for info in data.session.streams.values()),
        regions=recording.regions(data),
        has_minutes=bool(data.columns.time_ns.size),
        time_figures=data.drawn(results.time_figures) if data.columns.time_ns.size else None,
        comparison=results.paper_comparison(data),
        budget=error_budget(data),
        events=recording.events(data),
        streams=recording.streams(data),
        clock=recording.clock(data),
        provenance=recording.provenance(data),
        config_toml="\n".join(map(_cut, data.config_toml.splitlines())),
    )


def _cut(line: str) -> str:
    """A line of the configuration, without the end of a trajectory."""
    return line if len(line) <= LONGEST_LINE else f"{line[:LONGEST_LINE]} … ({len(line)} characters)"


def _facts(data: ReportData) -> str:
    """Place and time of the session in one line."""
    session = data.session
    start = formatting.local_time(session.start_ns, data.site)
    lasted = formatting.rounded_duration((session.end_ns - session.start_ns) / 1e9)
    when = f"{start:%Y-%m-%d %H:%M} to {data.clock_time(session.end_ns)} ({data.zone}), {lasted}"
    return f"{formatting.place(data.site)} · {when}"
