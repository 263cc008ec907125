"""``fieldkit import``: recordings of other programs become sessions."""

from __future__ import annotations

import re
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import click

from fieldkit.commands.common import Verb, options, print_json, say
from fieldkit.commands.types import SITE, ZONE
from fieldkit.errors import ConfigError, FieldkitError

FLIR = (".fff", ".seq", ".jpg", ".jpeg")
TABLES = (".csv", ".txt", ".tsv")

if TYPE_CHECKING:
    from fieldkit.config import Config
    from fieldkit.sessions.exchange.imported import Foreign
    from fieldkit.sessions.layout import SessionHeader
    from fieldkit.sessions.seal import SealReport
    from fieldkit.site import Site


@click.command(cls=Verb)
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), metavar="FILE.h5", help="[default: recordings/]"
)
@click.option("--as", "name", default="camera", show_default=True, metavar="NAME", help="Name of the stream.")
@click.option("--site", type=SITE, help="Where it was, if not the campaign's site.")
@click.option("--title", default="", help="Title of the session [default: the source's name].")
@click.option(
    "--kelvin-per-count",
    metavar="K|none",
    help="Scale of TIFF counts; none if it is not known. Never guessed.",
)
@click.option("--kelvin-at-zero", type=float, default=0.0, help="Kelvin of count 0 [default: 0].")
@click.option(
    "--times", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FILE.csv",
    help="Table of TIFF file names and times.",
)  # fmt: skip
@click.option("--time-format", metavar="FORMAT", help='Time in the TIFF file names, such as "%Y%m%dT%H%M%S".')
@click.option("--zone", type=ZONE, help="Zone of times that have none.")
@click.option("--offset", default="0s", metavar="[+-]Ns", help="Add to a table's times: its clock was slow.")
@click.option("--unit", default="", help="Unit of a table's numbers, if not in its header: C, K, lx, W/m2.")
@click.option("--column", "columns", multiple=True, metavar="NAME", help="Column of a table; repeatable.")
@click.option("--encoding", default="utf-8-sig", help="Of a table, such as cp932.")
@click.option(
    "--into", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="SESSION",
    help="Make a new session of this one and SOURCE together.",
)  # fmt: skip
@click.pass_context
def command(ctx: click.Context, /, source: Path, out: Path | None, site: Site | None, **given: Any) -> None:
    """Turn SOURCE into a session: PureThermal .raw.y16.gz, FLIR .fff .seq .jpg, 16-bit TIFFs, CSV tables.

    Regions of the campaign are taken along; draw them before or after (fieldkit roi).
    """
    from fieldkit.sessions.exchange.imported import write_foreign

    if given["into"] is not None:
        _tell(ctx, *_merge(source, out, given))
        return
    config = _campaign_or_none(ctx)
    place = site or (config.site if config else None)
    if place is None:
        fix = "--site LAT,LON,ALT, or run this inside a campaign (fieldkit init)"
        raise ConfigError("where this was recorded is not known, and slopes need it", fix=fix)
    foreign = _read(source, given)
    header = _header(foreign, place, config, given["title"] or source.name)
    path = out or _default_path(config, foreign, source)
    path.parent.mkdir(parents=True, exist_ok=True)
    report = write_foreign(path, header, foreign, str(source))
    _tell(ctx, report, foreign)


def _merge(source: Path, out: Path | None, given: dict[str, Any]) -> tuple[SealReport, Foreign]:
    """A new session beside the old one, with the stream of SOURCE in it."""
    from fieldkit.sessions.exchange.merged import merge
    from fieldkit.sessions.reader import open_session

    old: Path = given["into"]
    foreign = _read(source, given)
    path = out or old.with_name(f"{old.stem}-with-{given['name']}.h5")
    with open_session(old) as session:
        return merge(session, foreign, path, str(source)), foreign


def _tell(ctx: click.Context, report: SealReport, foreign: Foreign) -> None:
    if options(ctx).json:
        remarks = [text for _, text in foreign.remarks]
        print_json({"session": str(report.path), "samples": report.counts, "remarks": remarks})
        return
    for _, text in foreign.remarks:
        say(f"  {text}")
    counts = ", ".join(f"{name} {count}" for name, count in report.counts.items())
    click.echo(f"{report.path}  {counts} samples, {report.bytes / 1e6:.1f} MB")
    say(f"next: fieldkit show {report.path}")


def _read(source: Path, given: dict[str, Any]) -> Foreign:
    """SOURCE by what it is."""
    from fieldkit.sessions.exchange.purethermal import is_purethermal, read_purethermal

    zone = ZoneInfo(given["zone"]) if given["zone"] else None
    if source.is_dir():
        from fieldkit.sessions.exchange.tiffs import read_tiffs

        scale = _scale(given["kelvin_per_count"], given["kelvin_at_zero"])
        moments = {"times": given["times"], "time_format": given["time_format"], "zone": zone}
        return read_tiffs(source, scale, name=given["name"], **moments)
    if source.suffix.lower() in FLIR:
        from fieldkit.commands.import_flir import read_flir

        return read_flir(source, given["name"])
    if source.suffix.lower() in TABLES:
        from fieldkit.sessions.exchange.logs import LogColumns, read_log

        return read_log(
            source, given["name"], zone=zone, time_format=given["time_format"], unit=given["unit"],
            offset_ns=_offset_ns(given["offset"]), columns=LogColumns(values=given["columns"]),
            encoding=given["encoding"],
        )  # fmt: skip
    if is_purethermal(source):
        return read_purethermal(source, given["name"])
    raise ConfigError(
        f"{source} is nothing that fieldkit knows",
        fix="it reads .raw.y16.gz, .fff, .seq, radiometric .jpg, folders of 16-bit TIFF, .csv tables",
    )


def _offset_ns(text: str) -> int:
    """``+12s``, ``-0.5s`` or ``+2m`` in nanoseconds."""
    found = re.fullmatch(r"([+-]?\d+(?:\.\d+)?)([smh]?)", text)
    if found is None:
        raise click.BadParameter(f"{text!r} is no offset; write +12s or -2m", param_hint="--offset")
    return round(float(found[1]) * {"": 1, "s": 1, "m": 60, "h": 3600}[found[2]] * 1e9)


def _scale(kelvin_per_count: str | None, kelvin_at_zero: float) -> Any:
    from fieldkit.sessions.exchange.tiffs import Scale

    if kelvin_per_count is None:
        fix = "--kelvin-per-count 0.01 (the maker's number), or --kelvin-per-count none for pictures only"
        raise ConfigError("what one count of these TIFF pictures means is not known", fix=fix)
    try:
        return Scale(float("nan") if kelvin_per_count == "none" else float(kelvin_per_count), kelvin_at_zero)
    except ValueError:
        raise click.BadParameter(f"{kelvin_per_count!r} is no number, nor none") from None


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


def _header(foreign: Foreign, site: Site, config: Config | None, title: str) -> SessionHeader:
    from fieldkit.sessions.layout import SessionHeader

    regions = config.regions if config else ()
    line = shlex.join(["fieldkit", *sys.argv[1:]])
    return SessionHeader(title, site, foreign.streams, regions, command_line=line)


def _default_path(config: Config | None, foreign: Foreign, source: Path) -> Path:
    first = next(iter(foreign.samples))
    stamp = datetime.fromtimestamp(first.time_ns // 10**9, UTC).strftime("%Y%m%dT%H%M%SZ")
    word = source.name.split(".")[0]
    name = f"{stamp}-{''.join(c if c.isalnum() or c in '-_' else '-' for c in word)}.h5"
    return (config.recordings if config else Path()) / name
