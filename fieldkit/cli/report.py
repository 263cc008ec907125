"""``fieldkit report``: the report of a recorded session, or of several together, as one HTML file or PDF."""

from __future__ import annotations

import shlex
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.cli.estimating import config_for, estimator_for, minutes_of
from fieldkit.cli.failure import explain
from fieldkit.cli.session_paths import newest, resolved
from fieldkit.model.errors import FieldkitError, SessionError, StorageError
from fieldkit.views.report.pdf import refuse_without_printer, write_pdf

if TYPE_CHECKING:
    from fieldkit.estimation.estimator import Estimator, Minute
    from fieldkit.estimation.statistics import SdKind
    from fieldkit.model.samples import Frame
    from fieldkit.sessions.reader import Session
    from fieldkit.views.report import Part


@click.command(cls=common.Verb)
@click.argument("sessions", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="FILE.html, or FILE.pdf with the HTML beside it [default: HTML in the reports folder].",
)
@click.option(
    "--sd",
    type=click.Choice(["paper", "usual"]),
    default="paper",
    show_default=True,
    help="Standard deviation: the paper's eq. (9) as printed, or the ordinary one.",
)
@click.option("--open", "show", is_flag=True, help="Open it in the browser.")
@common.present_option
@common.set_option
@click.pass_context
def command(
    ctx: click.Context,
    sessions: tuple[Path, ...],
    out: Path | None,
    sd: SdKind,
    show: bool,
    present: bool,
    settings: tuple[str, ...],
) -> None:
    """Write the report of recorded SESSIONS: one HTML file that opens offline, or a PDF.

    One session, the campaign's newest where none is named, with everything about it; several, or a
    folder of them, with errors and figures over all. What `estimate -o BASE` wrote stands for its sessions
    and parameters: fieldkit report BASE.
    """
    from fieldkit.cli.batch import recalled

    sessions, settings, as_now = recalled(sessions, settings)
    present = present or as_now
    paths = resolved(ctx, sessions) if sessions else [newest(ctx, None)]
    pdf = out if out is not None and out.suffix == ".pdf" else None
    page = out if pdf is None else pdf.with_suffix(".html")
    if pdf is not None:
        refuse_without_printer()
    failed: list[FieldkitError] = []
    if len(paths) == 1:
        written = report_session(paths[0], page, sd=sd, settings=settings, present=present)
    else:
        written, failed = report_sessions(paths, page, sd=sd, settings=settings, present=present)
    if pdf is not None:
        with _writing(pdf):
            write_pdf(written, pdf)
        written = pdf
    _tell(paths, written)
    if show:
        webbrowser.open(written.resolve().as_uri())
    if failed:
        for error in failed:
            explain(error)
        raise SessionError(f"{len(failed)} of {len(paths)} sessions are not in the report")


def _tell(paths: Sequence[Path], written: Path) -> None:
    if common.options().json:
        common.print_json({"sessions": [str(path) for path in paths], "report": str(written)})
        return
    click.echo(written)
    from fieldkit.views import plotting

    if not plotting.available():
        common.say("the report has its tables; for figures: pip install 'fieldkit[lab]'")


def report_session(
    path: Path,
    out: Path | None = None,
    *,
    sd: SdKind = "paper",
    settings: Sequence[str] = (),
    present: bool = False,
) -> Path:
    """Estimate a session afresh, write its report, and say where.

    `out` None: ``reports/NAME.html`` of the campaign the session lies in, or beside the
    session. Raises `SessionError`, `ConfigError`, `StorageError`.
    """
    from fieldkit.sessions.reader import open_session
    from fieldkit.views.report import write_report

    out = out or default_path(path)
    with open_session(path) as session:
        config = config_for(session, settings, present=present)
        estimator = estimator_for(session, config, present=present)
        minutes = list(minutes_of(session, estimator))
        common.say_damage(session)
        with _writing(out):
            write_report(
                out,
                session,
                minutes,
                settings=estimator.settings,
                site=estimator.site,
                regions=estimator.regions,
                sd=sd,
                frame=middle_frame(session),
                full_minutes=with_full_model(minutes, estimator),
                command_line=shlex.join(["fieldkit", *sys.argv[1:]]),
                config_toml=config.to_toml(),
            )
    return out


def report_sessions(
    paths: Sequence[Path],
    out: Path | None = None,
    *,
    sd: SdKind = "paper",
    settings: Sequence[str] = (),
    present: bool = False,
) -> tuple[Path, list[FieldkitError]]:
    """Estimate several sessions afresh and write one report of them all; where, and what failed.

    A session that cannot be read is left out. Raises `SessionError` if none can, `StorageError`.
    """
    from fieldkit.views.report import write_campaign_report

    parts, failed = [], []
    for path in paths:
        try:
            parts.append(part_of(path, settings, present=present))
        except FieldkitError as error:
            failed.append(error)
    if not parts:
        raise failed[0]
    out = out or default_path(paths[0]).with_name("campaign.html")
    title = parts[0].path.resolve().parent.parent.name
    with _writing(out):
        command_line = shlex.join(["fieldkit", *sys.argv[1:]])
        write_campaign_report(out, title, parts, sd=sd, command_line=command_line)
    return out, failed


def part_of(path: Path, settings: Sequence[str] = (), *, present: bool = False) -> Part:
    """A session estimated afresh, as a part of a report of several. Raises `SessionError`, `ConfigError`."""
    from fieldkit.sessions.reader import open_session
    from fieldkit.views.report import Part
    from fieldkit.views.report.series import series

    with open_session(path) as session:
        estimator = estimator_for(session, config_for(session, settings, present=present), present=present)
        columns = series(list(minutes_of(session, estimator)), estimator.regions)
    return Part(path, estimator.site, columns, estimator.settings)


@contextmanager
def _writing(out: Path) -> Iterator[None]:
    """Make the folder of a file; what the disk refuses becomes a `StorageError`."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise StorageError(
            f"cannot write {out}: {error.strerror}", fix="name another place with -o"
        ) from error


def default_path(session: Path) -> Path:
    """``reports/NAME.html`` beside the recordings folder, or ``NAME.html`` beside a session elsewhere."""
    folder = session.resolve().parent
    name = f"{session.stem}.html"
    return folder.parent / "reports" / name if folder.name == "recordings" else session.parent / name


def middle_frame(session: Session) -> Frame | None:
    """The picture nearest to the middle of the session that has no flag against it, or None."""
    import numpy as np

    from fieldkit.model.samples import is_usable

    camera = next((name for name, info in session.streams.items() if info.is_camera), None)
    if camera is None:
        return None
    reader = session.stream(camera)
    good = np.flatnonzero(is_usable(reader.column("flags")))
    nearest = good[np.argsort(np.abs(good - len(reader) // 2), kind="stable")]
    frames = (reader.frame(row) for row in nearest.tolist())
    return next((frame for frame in frames if is_usable(frame.quality)), None)  # its checksum too


def with_full_model(minutes: Sequence[Minute], estimator: Estimator) -> list[Minute] | None:
    """The same minutes with slopes by the full surface model, from the bins already made.

    None where the full model was used in the first place.
    """
    from fieldkit.estimation.bins import History
    from fieldkit.estimation.slopes import slopes

    if estimator.settings.model == "full":
        return None
    settings = replace(estimator.settings, model="full")
    history = History.of(estimator.bins)
    return [
        replace(minute, estimates=slopes(history.until(index), estimator.regions, settings))
        for index, minute in enumerate(minutes, start=1)
    ]
