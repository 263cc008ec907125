"""The report of one session: gathers its data and renders the page."""

from __future__ import annotations

from pathlib import Path

from fieldkit.model.durations import rounded_duration
from fieldkit.views import formatting
from fieldkit.views.html import render
from fieldkit.views.report import recording, results
from fieldkit.views.report.assessment import assess
from fieldkit.views.report.emissivity_section import emissivity_section
from fieldkit.views.report.error_budget import error_budget
from fieldkit.views.report.learnt_section import learnt_section
from fieldkit.views.report.series import ReportData

LONGEST_LINE = 500
"""Of the configuration, in characters."""


def write_report(path: Path, data: ReportData) -> None:
    """Write the report of a session as one HTML file into an existing folder. Raises `OSError`."""
    page = render(
        "session_report.html",
        title=data.session.header.title or data.session.path.stem,
        facts=_facts(data),
        description=data.session.header.description,
        assessment=assess(data.columns, data.events, data.session.state),
        simulated=recording.is_simulated(data.session),
        slopes=results.slopes(data),
        accuracy=results.accuracy(data),
        slope_figures=data.draw(results.slope_figures),
        caveat=results.caveat(data.settings),
        learnt=learnt_section(data),
        frame=recording.frame_image(data),
        has_camera=any(info.is_camera for info in data.session.streams.values()),
        regions=recording.regions(data),
        has_minutes=bool(data.columns.time_ns.size),
        time_figures=data.draw(results.time_figures) if data.columns.time_ns.size else None,
        comparison=results.paper_comparison(data),
        budget=error_budget(data),
        emissivity=emissivity_section(data),
        events=recording.events(data),
        streams=recording.streams(data),
        clock=recording.clock(data),
        provenance=recording.provenance(data),
        config_toml="\n".join(map(_shorten, data.config_toml.splitlines())),
    )
    path.write_text(page, encoding="utf-8")


def _shorten(line: str) -> str:
    """A line of the configuration, without the end of a trajectory."""
    return line if len(line) <= LONGEST_LINE else f"{line[:LONGEST_LINE]} … ({len(line)} characters)"


def _facts(data: ReportData) -> str:
    """Place and time of the session in one line."""
    session = data.session
    start = formatting.local_time(session.start_ns, data.site)
    lasted = rounded_duration((session.end_ns - session.start_ns) / 1e9)
    when = f"{start:%Y-%m-%d %H:%M} to {data.clock_time(session.end_ns)} ({data.zone}), {lasted}"
    return f"{formatting.place(data.site)} · {when}"
