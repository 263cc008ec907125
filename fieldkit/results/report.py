"""Reports: sessions estimated and written as one HTML file, printed to PDF, or one image for a slide."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np
from markupsafe import Markup

from fieldkit.calibration.calibration_record import records_of
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator_keys import Model
from fieldkit.model.device import find_camera, regions_on
from fieldkit.model.door import checked
from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.model.installation import install_extra
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.samples import is_usable
from fieldkit.model.slope import SOLVED, SlopeEstimate
from fieldkit.palettes import INFERNO
from fieldkit.phrases import Words, counted
from fieldkit.physics.sun import sun_vectors
from fieldkit.results import sources
from fieldkit.results.batch import each
from fieldkit.results.check import emissivity_findings
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.result_files import campaign_folder, command_line, writing
from fieldkit.results.sources import SessionOrFile, Settings, config_for, log_warning, path_of
from fieldkit.sessions.formats.images_out import require_palette
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.views import formatting, frame_image, plotting
from fieldkit.views.html import require_weasyprint, write_pdf
from fieldkit.views.report import Part, ReportData, write_campaign_report, write_report
from fieldkit.views.report.assessment import assess
from fieldkit.views.report.recording import is_simulated
from fieldkit.views.report.series import series
from fieldkit.views.session_image import ShownFrame, session_image

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Minute
    from fieldkit.estimation.statistics import SdKind
    from fieldkit.model.samples import Frame


@dataclass(frozen=True)
class Report:
    """A written report: `path` of the HTML or PDF file, the sessions asked for, those that failed."""

    path: Path
    sessions: tuple[Path, ...]
    failures: Mapping[Path, FieldkitError] = field(default_factory=dict)

    def show(self) -> None:
        """Open the report in the browser, or whatever opens its kind of file."""
        webbrowser.open(self.path.resolve().as_uri())

    def __repr__(self) -> str:
        failed = f", {len(self.failures)} failed" if self.failures else ""
        return f"<Report {self.path}: {counted(len(self.sessions), 'session')}{failed}>"

    def _repr_html_(self) -> str:
        return str(Markup('<a href="{}">{}</a>').format(self.path.resolve().as_uri(), self.path))


@checked
@dataclass(frozen=True)
class ReportOptions:
    """Options of a report.

    `sd` is the standard deviation of absolute errors: the paper's eq. (9) as printed, or the usual
    one. `settings` are other values for keys of the configuration, such as ``{"albedo": 0.25}``; `present`
    takes the campaign's ``fieldkit.toml`` and regions as they are now. `palette` gives the frames of an image
    their colours, of `fieldkit.palettes.NAMES`; inferno by default.

    Examples
    --------
    >>> options = fieldkit.ReportOptions(settings={"albedo": 0.25})
    >>> fieldkit.report(session, "darker.html", options)
    <Report darker.html: 1 session>
    """

    sd: SdKind = "paper"
    settings: Settings = ()
    present: bool = False
    palette: str | None = None


DEFAULTS = ReportOptions()


def report(
    sessions: SessionOrFile | Sequence[SessionOrFile],
    out: str | Path | None = None,
    options: ReportOptions = DEFAULTS,
    *,
    executor: Executor | None = None,
    notify: Callable[[str], None] = log_warning,
) -> Report:
    """Write the report of a session, or one of several sessions together.

    Parameters
    ----------
    sessions
        A session or its file, or several.
    out
        ``FILE.html``, ``FILE.pdf`` with the HTML beside it, or ``FILE.png``, one image of a session for a
        slide; by default HTML in the campaign's ``reports`` folder, or beside a session elsewhere.
    options
        How the sessions are estimated and summarised.
    executor
        Any of `concurrent.futures`, whose workers estimate the sessions of a report of several; this process
        unless given.
    notify
        Receives notes, such as damaged samples that were excluded.

    Returns
    -------
    Report
        Of several sessions, those that cannot be read are in its `failures`.

    Raises
    ------
    SessionError, ConfigError
        If no session can be read or estimated.
    StorageError
        If the report cannot be written.

    Examples
    --------
    >>> fieldkit.report(session, "noon.html")
    <Report noon.html: 1 session>
    """
    several = (sessions,) if isinstance(sessions, str | Path | SessionReader) else sessions
    paths = tuple(map(path_of, several))
    if not paths:
        raise ConfigError("no sessions to report", fix="give a session, its file, or several")
    target = None if out is None else Path(out)
    kind = ".html" if target is None else target.suffix.lower()
    if kind not in (".html", ".pdf", ".png"):
        raise ConfigError("a report is HTML, PDF or an image", place=target, fix="name a file of these")
    pdf = target if kind == ".pdf" else None
    page = target if pdf is None else pdf.with_suffix(".html")
    if pdf is not None:
        require_weasyprint()
    failures: dict[Path, FieldkitError] = {}
    if len(paths) > 1 and kind == ".png":
        raise ConfigError("an image is of one session", place=out, fix="name one session, or a file.html")
    if options.palette is not None and kind != ".png":
        raise ConfigError(
            "only an image has a palette", place=Argument("palette"), fix="name a .png, or omit it"
        )
    if len(paths) == 1:
        pages = _report_session(paths[0], page, options, notify)
    else:
        pages, failures = _report_sessions(paths, page, options, executor)
    if pdf is None:
        return Report(pages, paths, failures)
    with writing(pdf):
        write_pdf(pages, pdf)
    return Report(pdf, paths, failures)


def _report_session(
    path: Path, out: Path | None, options: ReportOptions, notify: Callable[[str], None]
) -> Path:
    out = out or default_path(path)
    with open_session(path) as session:
        minutes = _minutes(session, options)
        config = minutes.run.source.config
        sources.notify_damage(session, notify, minutes.measured.damaged)
        if out.suffix.lower() == ".png":
            image = _image(session, minutes, options, notify)
            with writing(out):
                out.write_bytes(image)
            return out
        records, regions = config.calibrations(), minutes.schedule.latest
        estimated = minutes.minutes()
        cautions = emissivity_findings(estimated, regions, records)
        with writing(out):
            data = ReportData(
                session,
                estimated,
                minutes.settings,
                minutes.site,
                regions,
                config.to_toml(),
                sd=options.sd,
                frame=middle_frame(session),
                by_others=by_other_models(minutes, estimated),
                command_line=command_line(),
                is_recordings=minutes.measured.is_recordings,
                budgets=minutes.estimates().budgets,
                checks=minutes.estimates().checks,
                calibrations=list(records_of(session.path.name, config.calibration)),
                active=records,
                cautions=[f"{caution.what}: {caution.text}" for caution in cautions],
            )
            write_report(out, data)
    return out


def _report_sessions(
    paths: Sequence[Path], out: Path | None, options: ReportOptions, executor: Executor | None
) -> tuple[Path, dict[Path, FieldkitError]]:
    """One report of all sessions that can be read; raises the first failure where none can."""
    by_session = each(report_part, paths, executor, options)
    parts, failures = list(by_session.values()), by_session.failures
    if not parts:
        raise next(iter(failures.values()))
    out = out or default_path(paths[0]).with_name("campaign.html")
    parts.sort(key=lambda part: part.columns.time_ns[:1].tolist())
    title = parts[0].path.resolve().parent.parent.name
    with writing(out):
        write_campaign_report(out, title, parts, sd=options.sd, command_line=command_line())
    return out, failures


def report_part(path: Path, options: ReportOptions = DEFAULTS) -> Part:
    """A session, estimated, as a part of a report of several. Raises `SessionError`, `ConfigError`."""
    with open_session(path) as session:
        minutes = _minutes(session, options)
        columns = series(minutes.minutes(), minutes.schedule.latest)
        warnings = assess(columns, list(session.events()), session.state).warnings
        return Part(path, minutes.site, columns, minutes.settings, warnings, is_simulated(session))


def _minutes(session: SessionReader, options: ReportOptions) -> SessionMinutes:
    config = config_for(session, options.settings, present=options.present)
    return SessionMinutes(session, config, present=options.present)


def default_path(session: Path) -> Path:
    """``reports/NAME.html`` beside the recordings folder, or ``NAME.html`` beside a session elsewhere."""
    return (campaign_folder(session, "reports") or session.parent) / f"{session.stem}.html"


def middle_frame(session: SessionReader) -> Frame | None:
    """The usable frame nearest to the middle of the session, or None."""
    camera = find_camera(session.streams.values())
    if camera is None:
        return None
    reader = session.stream(camera.name)
    good = np.flatnonzero(is_usable(reader.column("flags")))
    nearest = good[np.argsort(np.abs(good - len(reader) // 2), kind="stable")]
    frames = (reader.frame(row) for row in nearest.tolist())
    # the stored flags do not include the checksum; reading the frame verifies it
    return next((frame for frame in frames if is_usable(frame.quality)), None)


def by_other_models(
    known: SessionMinutes, minutes: Sequence[Minute]
) -> dict[Model, tuple[SlopeEstimate, ...]]:
    """The slopes by each other model at the last minute that has one by the model that was used."""
    solved = [
        row for row, minute in enumerate(minutes) if {slope.state for slope in minute.estimates} & set(SOLVED)
    ]
    if not solved:
        return {}
    history = known.measured.history.until(solved[-1] + 1)
    return {
        model: SlopeChain(known.schedule, replace(known.settings, model=model)).at(history).slopes
        for model in get_args(Model)
        if model != known.settings.model
    }


# One image of a session for a slide


def _image(
    session: SessionReader, known: SessionMinutes, options: ReportOptions, notify: Callable[[str], None]
) -> bytes:
    """A PNG file of a session whose minutes are known.

    Raises `ConfigError` without matplotlib, such a palette or a usable frame; a map that cannot be made is
    reported to `notify` and left out.
    """
    if not plotting.available():
        raise ConfigError(Words("error.matplotlib"), fix=install_extra("lab"))
    from fieldkit.results.slope_map import slope_map  # maps and their libraries take as long as all others

    palette = options.palette or INFERNO
    require_palette(palette)
    frames = list(_shown_frames(session, known))
    if not frames:
        raise ConfigError(Words("error.no_frame"), place=session.path, fix=Action.CHECK(session.path))
    try:
        session_map = slope_map(session, settings=options.settings, present=options.present)
        mapped = None if session_map.along_sun is not None else session_map.slopes
    except FieldkitError as error:
        notify(f"the image has no map: {error.message}")
        mapped = None
    site, start, end = known.site, session.start_ns, session.end_ns
    day, until = formatting.local_time(start, site), formatting.clock_time(end, site, since_ns=start)
    zone = formatting.zone_name(start, site, end)
    subtitle = f"{day:%Y-%m-%d %H:%M} to {until} {zone}   {formatting.place(site)}"
    estimates = list(known.estimates().final.values())
    camera, streams = find_camera(session.streams.values()), session.streams.values()
    regions = regions_on(camera.name, known.schedule.latest, streams) if camera else ()
    return session_image(session.path.stem, subtitle, frames, regions, mapped, estimates, palette)


def _shown_frames(session: SessionReader, known: SessionMinutes) -> Iterator[ShownFrame]:
    """The first usable frame, the one nearest to the highest sun, the last."""
    camera = find_camera(session.streams.values())
    if camera is None:
        return
    reader = session.stream(camera.name)
    usable = np.flatnonzero(is_usable(reader.flags()))
    if not usable.size:
        return
    times = session.times_ns(camera.name)[usable]
    highest = int(np.argmax(sun_vectors(times, known.site)[:, 2]))
    rows = {"first": usable[0], "highest sun": usable[highest], "last": usable[-1]}
    by_row = {
        int(row): name for name, row in reversed(rows.items())
    }  # one that is two of them is the earlier
    for row in sorted(by_row):
        frame = reader.frame(row)
        at = formatting.clock_time(frame.time_ns, known.site, since_ns=session.start_ns)
        words = f"{by_row[row]}, {at}"
        yield ShownFrame(words, frame_image.values(frame, camera), frame_image.unit(camera))
