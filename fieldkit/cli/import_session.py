"""``fieldkit import``: recordings of other programs become sessions."""

from __future__ import annotations

import math
import re
import shlex
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, options, print_json, say
from fieldkit.cli.types import SITE, ZONE
from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.model.radiation import COMPONENTS
from fieldkit.model.samples import Severity

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.model.site import Site
    from fieldkit.sessions.formats.imported import ImportedRecording
    from fieldkit.sessions.layout import SessionHeader
    from fieldkit.sessions.reader import Session
    from fieldkit.sessions.seal import SealReport

KM_PER_DEGREE, NEAR_KM = 111.2, 2.0


def _stream_name(ctx: click.Context, param: click.Parameter, name: str | None) -> str | None:
    from fieldkit.sessions.layout import RESERVED_NAMES

    if name is not None and (name in RESERVED_NAMES or not re.fullmatch(r"\w[\w.-]{0,30}", name)):
        raise click.BadParameter(f"{name!r} cannot name a stream; take letters and digits, like logger2")
    return name


@click.command(cls=Command)
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), metavar="FILE.h5", help="[default: recordings/]"
)
@click.option(
    "--as",
    "name",
    metavar="NAME",
    callback=_stream_name,
    help="Name of the stream [default: camera, station or logger].",
)
@click.option(
    "--site", type=SITE, help="Where it was [default: as a station's file says, else the campaign's]."
)
@click.option("--title", default="", help="Title of the session [default: the source's name].")
@click.option(
    "--kelvin-per-count",
    metavar="K|none",
    help="Scale of TIFF or IRG counts; none if it is not known. Never guessed.",
)
@click.option("--kelvin-at-zero", type=float, default=0.0, help="Kelvin of count 0 [default: 0].")
@click.option(
    "--times", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FILE.csv",
    help="Table of the pictures' file names and times.",
)  # fmt: skip
@click.option(
    "--time-format", metavar="FORMAT", help='Time in the pictures\' names, such as "%Y%m%dT%H%M%S".'
)
@click.option("--zone", type=ZONE, help="Zone of times that have none.")
@click.option(
    "--offset", default="0s", metavar="[+-]Ns|auto",
    help="Add to a table's times: its clock was slow; auto finds it on the curves of --into.",
)  # fmt: skip
@click.option(
    "--unit", default="", help="Unit of a table's numbers, if not in its header: C, F, K, lx, klx, fc, W/m2."
)
@click.option("--column", "columns", multiple=True, metavar="NAME", help="Column of a table; repeatable.")
@click.option(
    "--measures", type=click.Choice(COMPONENTS),
    help="What a table in W/m2 measures, if its columns are not called so: ghi, dni ...",
)  # fmt: skip
@click.option("--encoding", default="utf-8-sig", help="Of a table, such as cp932.")
@click.option(
    "--into", type=click.Path(path_type=Path), metavar="SESSION",
    help="Make a new session of this one and SOURCE together.",
)  # fmt: skip
@click.pass_context
def command(ctx: click.Context, /, source: Path, out: Path | None, site: Site | None, **given: Any) -> None:
    """Turn SOURCE into a session: pictures, tables of loggers, files of weather stations.

    PureThermal .raw.y16.gz; FLIR .fff, .seq, radiometric .jpg, 16-bit TIFF and .irg, or folders of them;
    tables, also of Campbell and HOBO loggers; SURFRAD, BSRN, downloads and radiation tables of the Japan
    Meteorological Agency.

    Regions of the campaign are taken along; draw them before or after (fieldkit roi).
    """
    from fieldkit.cli.import_sources import AUTO, read_source
    from fieldkit.sessions.formats.imported import write_imported

    if given["offset"] == AUTO and given["into"] is None:
        raise click.UsageError("--offset auto needs the session to align with: --into SESSION")
    if given["into"] is not None:
        from fieldkit.cli.session_paths import find_session

        _tell(ctx, *_merge(source, out, {**given, "into": find_session(ctx, given["into"])}))
        return
    foreign = read_source(source, given)
    config = _campaign_or_none(ctx)
    place, foreign = _placed(foreign, site, config)
    header = _header(foreign, place, config, given["title"] or source.name)
    path = out or _default_path(config, foreign, source)
    path.parent.mkdir(parents=True, exist_ok=True)
    report = write_imported(path, header, foreign, str(source))
    _tell(ctx, report, foreign)


def _placed(
    foreign: ImportedRecording, site: Site | None, config: Config | None
) -> tuple[Site, ImportedRecording]:
    """Where it was recorded, and the recording with a warning where that is only the campaign's word."""
    place = site or foreign.site
    if place is not None:
        return place, foreign
    if config is None:
        fix = "--site LAT,LON,ALT, or run this inside a campaign (fieldkit init)"
        raise ConfigError("where this was recorded is not known, and slopes need it", fix=fix)
    place = config.site
    where = f"{place.latitude_deg:g}, {place.longitude_deg:g}{_of_the_paper(place)}"
    said = (
        f"no --site: taken as recorded at the campaign's site, {where}; "
        "if it was elsewhere, import it again with --site LAT,LON,ALT"
    )
    return place, replace(foreign, remarks=(*foreign.remarks, (Severity.WARNING, said)))


def _of_the_paper(site: Site) -> str:
    from fieldkit.config.template import PAPER_SITE

    given = site.latitude_deg, site.longitude_deg
    is_default = given == (PAPER_SITE["latitude_deg"], PAPER_SITE["longitude_deg"])
    return " (the paper's, which fieldkit init writes unless told another)" if is_default else ""


def _merge(source: Path, out: Path | None, given: dict[str, Any]) -> tuple[SealReport, ImportedRecording]:
    """A new session beside the old one, with the streams of SOURCE in it."""
    from fieldkit.cli.import_sources import AUTO, read_source
    from fieldkit.sessions.formats.merged import aligned, cut_to, merge
    from fieldkit.sessions.reader import open_session

    old: Path = given["into"]
    foreign = read_source(source, given)
    path = out or old.with_name(f"{old.stem}-with-{given['name'] or foreign.streams[0].name}.h5")
    with open_session(old) as session:
        if given["offset"] == AUTO:
            foreign = aligned(session, foreign)
        foreign = cut_to(session, _far(foreign, session.site))
        foreign = _another_light(session, foreign)
        return merge(session, foreign, path, str(source)), foreign


def _another_light(session: Session, foreign: ImportedRecording) -> ImportedRecording:
    """The recording, with a warning where slopes will take their light from it instead of the session."""
    from fieldkit.estimation.instruments import sunlight_source
    from fieldkit.estimation.settings import EstimatorSettings

    own = tuple(session.streams.values())
    before, after = (
        sunlight_source(streams, EstimatorSettings()) for streams in (own, own + foreign.streams)
    )
    if before is None or after is None or before.info.name == after.info.name:
        return foreign
    said = (
        f"slopes now take their light from {after.info.name} ({after.measures}), not {before.info.name}; "
        f'irradiance.stream = "{before.info.name}" keeps it'
    )
    return replace(foreign, remarks=(*foreign.remarks, (Severity.WARNING, said)))


def _far(foreign: ImportedRecording, site: Site) -> ImportedRecording:
    """The recording, with a warning where it was made at another place than the session."""
    if foreign.site is None:
        return foreign
    north = foreign.site.latitude_deg - site.latitude_deg
    east = (foreign.site.longitude_deg - site.longitude_deg) * math.cos(math.radians(site.latitude_deg))
    apart_km = KM_PER_DEGREE * math.hypot(north, east)
    if apart_km < NEAR_KM:
        return foreign
    said = f"the station stands {apart_km:.0f} km from the session's site: its clouds are others"
    return replace(foreign, remarks=(*foreign.remarks, (Severity.WARNING, said)))


def _tell(ctx: click.Context, report: SealReport, foreign: ImportedRecording) -> None:
    if options(ctx).json:
        remarks = [text for _, text in foreign.remarks]
        print_json({"session": str(report.path), "samples": report.counts, "remarks": remarks})
        return
    for severity, text in foreign.remarks:
        say(f"  {'warning: ' if severity is Severity.WARNING else ''}{text}")
    counts = ", ".join(f"{name} {count}" for name, count in report.counts.items())
    click.echo(f"{report.path}  {counts} samples, {report.bytes / 1e6:.1f} MB")
    say(f"next: fieldkit show {report.path}")


def _campaign_or_none(ctx: click.Context) -> Config | None:
    """The campaign around, if there is one; one with mistakes is told and left aside."""
    from fieldkit.config import find_campaign, load_config

    try:
        file = find_campaign(options(ctx).directory or Path.cwd())
    except ConfigError:
        return None
    try:
        return load_config(file)
    except FieldkitError as error:
        say(f"the campaign is left aside: {error.message}")
        return None


def _header(foreign: ImportedRecording, site: Site, config: Config | None, title: str) -> SessionHeader:
    from fieldkit.sessions.layout import SessionHeader

    regions = config.regions if config else ()
    line = shlex.join(["fieldkit", *sys.argv[1:]])
    return SessionHeader(title, site, foreign.streams, regions, command_line=line)


def _default_path(config: Config | None, foreign: ImportedRecording, source: Path) -> Path:
    first = next(iter(foreign.samples))
    stamp = datetime.fromtimestamp(first.time_ns // 10**9, UTC).strftime("%Y%m%dT%H%M%SZ")
    word = source.name.split(".")[0]
    name = f"{stamp}-{''.join(c if c.isalnum() or c in '-_' else '-' for c in word)}.h5"
    return (config.recordings if config else Path()) / name
