"""``fieldkit import``: recordings of other programs become sessions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, print_if_json, say, working_folder
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import CLOCK_OFFSET, FILE, KELVIN_PER_COUNT, NUMBER, PATH, SITE
from fieldkit.model.samples import Severity

if TYPE_CHECKING:
    from fieldkit.results.importing import ImportedSession


# all options but --out and --into go into `ImportOptions`: the second name is that of its field
@click.command(cls=Command)
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--out", type=PATH, metavar="FILE.h5", help="[default: recordings/]")
@click.option("--as", "name", metavar="NAME", help="Name of the stream [default: camera, station or logger].")
@click.option(
    "--site",
    type=SITE,
    help="Where it was recorded [default: as a station's file states, else the campaign's].",
)
@click.option("--title", default="", help="Title of the session [default: the source's name].")
@click.option(
    "--kelvin-per-count",
    type=KELVIN_PER_COUNT,
    help="Scale of TIFF, PNG or IRG counts; none if it is not known. Never guessed.",
)
@click.option("--kelvin-at-zero", type=NUMBER, default=0.0, help="Kelvin of count 0 [default: 0].")
@click.option("--times", type=FILE, metavar="FILE.csv", help="Table of the frames' file names and times.")
@click.option("--time-format", metavar="FORMAT", help='Time in the frames\' names, such as "%Y%m%dT%H%M%S".')
@click.option("--zone", metavar="ZONE", help="Zone of times that have none.")
@click.option(
    "--clock-offset",
    "offset_s",
    type=CLOCK_OFFSET,
    help="Add to the times of SOURCE, if its clock was slow; auto finds a table's from --into. "
    "[default: 0s; of a session, measured]",
)
@click.option(
    "--unit",
    default="",
    help="Unit of a table's values, if not in its header, or of float TIFF: C, F, K, lx, klx, fc, W/m2, m/s.",
)
@click.option("--column", "columns", multiple=True, metavar="NAME", help="Column of a table; repeatable.")
@click.option(
    "--time",
    "time_columns",
    multiple=True,
    metavar="NAME",
    help="Column of a table's time; of its parts, one after the other.",
)
@click.option("--start", metavar="TIME", help="Moment of 0 of a table's times that count: 2026-12-11T12:00.")
@click.option("--date", metavar="DAY", help="Day of a table's first row, if its times have none: 2026-12-11.")
@click.option(
    "--keep",
    type=click.Choice(("first", "last")),
    help="Rows of a table to keep of times that come twice, because its clock was set back.",
)
@click.option(
    "--measures",
    multiple=True,
    metavar="[COLUMN=]ghi",
    help="What a column in W/m2 measures, if not in its name: ghi, dni ...; repeatable with COLUMN.",
)
@click.option("--encoding", default="utf-8-sig", help="Encoding of a table, such as cp932.")
@click.option("--sheet", default="", metavar="NAME", help="Sheet of a workbook with several tables.")
@click.option(
    "--into", type=PATH, metavar="SESSION", help="Make a new session of this one and SOURCE together."
)
def command(source: Path, out: Path | None, into: Path | None, **stated: Any) -> None:
    """Turn SOURCE into a session: frames, tables of loggers, files of weather stations.

    PureThermal .raw.y16.gz; FLIR .fff, .seq, radiometric .jpg, TIFF (16 bits, floats), 16-bit PNG and .irg,
    or folders of them; tables, also of Campbell and HOBO loggers; SURFRAD, BSRN;
    downloads and radiation tables of the Japan Meteorological Agency. With --into also another session,
    which a second recorder took at the same place and time.

    The session gets the regions of the campaign; draw them before or after (fieldkit roi).
    """
    from fieldkit.results.importing import ImportOptions, import_into, import_recording
    from fieldkit.results.result_files import command_line
    from fieldkit.sessions.reader import open_session

    pairs = [text.rpartition("=")[::2] for text in stated.pop("measures")]
    import_options = ImportOptions(**stated, measures=dict(pairs) or "")
    if into is not None:
        with open_session(find_session(into)) as session:
            _print(import_into(session, source, out, import_options))
        return
    folder, words = working_folder(), command_line()
    _print(import_recording(source, out, import_options, campaign=folder, command_line=words, notify=say))


def _print(session: ImportedSession) -> None:
    notes = [text for _, text in session.notes]
    if print_if_json({"session": str(session.path), "samples": session.samples, "remarks": notes}):
        return
    for severity, text in session.notes:
        say(f"  {'warning: ' if severity is Severity.WARNING else ''}{text}")
    counts = ", ".join(f"{name} {count}" for name, count in session.samples.items())
    click.echo(f"{session.path}  {counts} samples, {session.size_bytes / 1e6:.1f} MB")
    say(f"next: fieldkit show {session.path}")
