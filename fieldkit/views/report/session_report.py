"""Puts the report of a session together and writes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.statistics import SdKind
from fieldkit.model.samples import Frame
from fieldkit.model.site import Region, Site
from fieldkit.views import formatting, plotting
from fieldkit.views.html import Html, bullets, element, page, paragraph
from fieldkit.views.report import error_budget, recording, results
from fieldkit.views.report.assessment import verdict
from fieldkit.views.report.report_data import Material
from fieldkit.views.report.series import series

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute
    from fieldkit.sessions.reader import Session


def write_report(
    path: Path,
    session: Session,
    minutes: Sequence[Minute],
    *,
    settings: EstimatorSettings,
    site: Site | None = None,
    regions: Sequence[Region] | None = None,
    sd: SdKind = "paper",
    frame: Frame | None = None,
    full_minutes: Sequence[Minute] | None = None,
    command_line: str = "",
    config_toml: str | None = None,
) -> None:
    """Write the report of a session as one HTML file that holds all it needs.

    Parameters
    ----------
    path
        The file to write; its folder must exist.
    session
        An open session.
    minutes, settings
        What the estimator made of its samples, and how.
    site, regions
        Those the estimator used, where they are not the session's own.
    sd
        Standard deviation of the absolute errors: eq. (9) as printed, or the usual one.
    frame
        The picture to show, None if there is none.
    full_minutes
        The same samples estimated with the full surface model: says what leaving terms out
        costs.
    command_line
        What was typed, for the provenance.
    config_toml
        The configuration used, where it is not the session's own.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    regions = tuple(session.regions if regions is None else regions)
    material = Material(
        session=session,
        site=site or session.site,
        regions=regions,
        columns=series(minutes, regions),
        settings=settings,
        sd=sd,
        events=tuple(formatting.by_time(session.events())),
        frame=frame,
        full=None if full_minutes is None else series(full_minutes, regions),
        command_line=command_line,
        config_toml=session.config_toml if config_toml is None else config_toml,
        figures=plotting.available(),
    )
    path.write_text(_page(material), encoding="utf-8")


def _page(material: Material) -> str:
    title = material.session.header.title or material.session.path.stem
    return page(
        f"{title}: fieldkit report",
        _header(material, title),
        results.beds(material),
        recording.seen(material),
        results.over_time(material),
        results.against_the_paper(material),
        error_budget.error_budget(material),
        recording.events(material),
        recording.streams(material),
        recording.clock(material),
        recording.provenance(material),
    )


def _header(material: Material, title: str) -> Html:
    session = material.session
    found = verdict(material.columns, material.events, session.state)
    start = formatting.local_time(session.start_ns, material.site)
    zone = formatting.zone_name(session.start_ns, material.site)
    lasted = formatting.duration((session.end_ns - session.start_ns) / 1e9)
    when = f"{start:%Y-%m-%d %H:%M} to {material.when(session.end_ns)} ({zone}), {lasted}"
    return element(
        "header",
        element("h1", title),
        paragraph(f"{formatting.place(material.site)} · {when}", class_="facts"),
        paragraph(session.header.description, class_="facts") if session.header.description else "",
        paragraph(found.headline, class_="verdict doubt" if found.doubts else "verdict"),
        bullets(found.doubts) if found.doubts else paragraph("Nothing went wrong while recording."),
    )
