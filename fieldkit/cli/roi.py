"""``fieldkit roi``: the regions of the image, kept in ``fieldkit.toml``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import CommandGroup, options, print_json, print_table, say
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import OR_RECORD, RECT, XY
from fieldkit.model.errors import ConfigError

if TYPE_CHECKING:
    from fieldkit.config import Config, Mistake
    from fieldkit.model.site import Region
    from fieldkit.workflows.regions import Picture, RegionInspection

Point = tuple[float, float]

_TILT = click.option(
    "--tilt", type=click.FloatRange(0, 90), help="Tilt by inclinometer, degrees from horizontal."
)
_AZIMUTH = click.option(
    "--azimuth", type=click.FloatRange(0, 360), help="Azimuth by compass, degrees from north, clockwise."
)
_EMISSIVITY = click.option(
    "--emissivity",
    type=OR_RECORD,
    help="Emissivity in the camera's band, or a record of calibrate emissivity.",
)
_OFFSET = click.option(
    "--offset",
    type=OR_RECORD,
    metavar="K|@NAME",
    help="Temperature offset of the camera there, or a record of calibrate uniformity.",
)


@click.group(cls=CommandGroup)
def command() -> None:
    """Manage the regions of the image: targets, and the flat reference.

    Pixels count from 0 at the top left, x to the right, y down.
    """


@command.command("add")
@click.argument("name")
@click.argument("more", nargs=-1, type=XY, metavar="[X,Y]...")
@click.option("--points", "first", type=XY, metavar="X,Y X,Y X,Y ...", help="Corners, at least three.")
@click.option("--rect", type=RECT, help="Rectangle: left, top, width, height.")
@click.option(
    "--reference/--target", help="Flat reference, or target whose slope is estimated [default: target]."
)
@_TILT
@_AZIMUTH
@_EMISSIVITY
@_OFFSET
@click.pass_context
def add(
    ctx: click.Context,
    name: str,
    more: tuple[Point, ...],
    first: Point | None,
    rect: tuple[float, float, float, float] | None,
    reference: bool,
    tilt: float | None,
    azimuth: float | None,
    emissivity: float | str | None,
    offset: float | str | None,
) -> None:
    r"""Add the region NAME to fieldkit.toml.

    \b
    fieldkit roi add flat --reference --rect 6,30,32,61
    fieldkit roi add b15 --points 82,30 113,30 113,90 82,90 --tilt 15 --azimuth 180
    """
    from fieldkit.config.edit import add_region

    if (first is None) == (rect is None) or (rect and more):
        raise click.UsageError("give the corners by --points, or a rectangle by --rect")
    points = [first, *more] if first else _corners(*rect) if rect else []
    region = {
        "name": name,
        "kind": "reference" if reference else "target",
        "points_px": [[_short(x), _short(y)] for x, y in points],
        **_known(tilt_deg=tilt, azimuth_deg=azimuth, emissivity=emissivity, offset_k=offset),
    }
    file = _file(ctx)
    add_region(file, region)
    if options(ctx).json:
        print_json({"config": str(file), "region": region})
    say(f"region {name} added to {file}")
    _tell_failures(file, name)


@command.command("edit")
@click.argument("name")
@click.option(
    "--shrink", type=click.FloatRange(0, min_open=True), metavar="PX", help="Move every edge inwards."
)
@_TILT
@_AZIMUTH
@_EMISSIVITY
@_OFFSET
@click.pass_context
def edit(
    ctx: click.Context,
    name: str,
    shrink: float | None,
    tilt: float | None,
    azimuth: float | None,
    emissivity: float | str | None,
    offset: float | str | None,
) -> None:
    """Change the region NAME in fieldkit.toml: its size or its measured properties.

    Sessions keep the regions they were recorded with; with --campaign, estimate, report and map use the
    new ones.
    """
    from fieldkit.config.edit import change_region

    changes = _known(tilt_deg=tilt, azimuth_deg=azimuth, emissivity=emissivity, offset_k=offset)
    if shrink is not None:
        changes["points_px"] = _shrunk_points(_read(ctx)[0], name, shrink)
    if not changes:
        raise click.UsageError("give what to change: --shrink, --tilt, --azimuth, --emissivity or --offset")
    file = _file(ctx)
    change_region(file, name, changes)
    if options(ctx).json:
        print_json({"config": str(file), "region": {"name": name, **changes}})
    say(f"region {name} changed in {file}")
    _tell_failures(file, name)


@command.command("remove")
@click.argument("name")
@click.pass_context
def remove(ctx: click.Context, name: str) -> None:
    """Remove the region NAME from fieldkit.toml."""
    from fieldkit.config.edit import remove_region

    file = _file(ctx)
    remove_region(file, name)
    if options(ctx).json:
        print_json({"config": str(file), "removed": name})
    say(f"region {name} removed from {file}")


@command.command("list")
@click.pass_context
def list_(ctx: click.Context) -> None:
    """List the regions."""
    regions = _read(ctx)[0].regions
    if options(ctx).json:
        print_json({"regions": [_document(region) for region in regions]})
    elif regions:
        print_table(("name", "kind", "tilt/azimuth", "corners"), [_row(region) for region in regions])
    else:
        say("no regions yet: fieldkit roi add")


@command.command("check")
@click.option(
    "--on",
    "session",
    type=click.Path(path_type=Path),
    metavar="SESSION",
    help="Check against the frames of this session.",
)
@click.pass_context
def check(ctx: click.Context, session: Path | None) -> None:
    """Check size, overlap and position of every region; with --on also temperature spread and edges.

    Exit code 3 if a region is unusable.
    """
    from fieldkit.workflows.regions import mean_picture

    config, mistakes = _read(ctx)
    inspections = _inspections(config, mean_picture(find_session(ctx, session)) if session else None)
    remarks = [mistake.said for _, mistake in mistakes if mistake.path[:1] == ("region",)]
    failed = bool(remarks) or any(inspection.level == "FAIL" for inspection in inspections)
    if options(ctx).json:
        print_json(
            {
                "regions": [inspection.document() for inspection in inspections],
                "mistakes": remarks,
                "ok": not failed,
            }
        )
    else:
        print_table(
            ("name", "tilt/azimuth", "pixels", "spread", ""), [inspection.row() for inspection in inspections]
        )
        for remark in remarks:
            click.echo(f"FAIL: {remark}")
    ctx.exit(ConfigError.exit_code if failed else 0)


def _file(ctx: click.Context) -> Path:
    from fieldkit.config import find_campaign

    return find_campaign(options(ctx).directory or Path.cwd())


def _read(ctx: click.Context) -> tuple[Config, list[tuple[str, Mistake]]]:
    from fieldkit.config import ConfigMistakesError, read_config

    file = _file(ctx)
    config, mistakes = read_config(file)
    if config is None:
        raise ConfigMistakesError(mistakes, fix=f"edit {file}")
    return config, mistakes


def _inspections(config: Config, picture: Picture | None = None) -> list[RegionInspection]:
    """What is found about each region, in the picture or one of the size the campaign states."""
    from fieldkit.workflows.regions import check_regions

    camera = config.tables.camera
    stated = (camera.height_px, camera.width_px) if camera and camera.height_px and camera.width_px else None
    return check_regions(config.regions, stated if picture is None else picture.shape, picture)


def _known(**values: float | str | None) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _tell_failures(file: Path, name: str) -> None:
    """Say at once if the region cannot be used as it is now."""
    from fieldkit.config import read_config

    config, _ = read_config(file)
    for inspection in _inspections(config) if config else ():
        if inspection.region.name == name and inspection.level != "ok":
            said = "; ".join(inspection.failures + inspection.warnings)
            say(f"  {name}: {inspection.pixels} px; {said}; see fieldkit roi check")


def _shrunk_points(config: Config, name: str, pixels: float) -> list[list[int | float]]:
    """Corners of the region called `name`, that much smaller; none if there is no such region."""
    region = next((region for region in config.regions if region.name == name), None)
    try:
        corners = region.shrunk(pixels).vertices if region else ()
    except ValueError as error:
        raise ConfigError(str(error), fix="a smaller --shrink") from error
    return [[_short(round(x, 1)), _short(round(y, 1))] for x, y in corners]


def _corners(x: float, y: float, width: float, height: float) -> list[Point]:
    """The corner pixels of a rectangle `width` x `height` pixels large."""
    right, bottom = x + width - 1, y + height - 1
    return [(x, y), (right, y), (right, bottom), (x, bottom)]


def _short(value: float) -> int | float:
    return int(value) if value.is_integer() else value


def _row(region: Region) -> tuple[str, ...]:
    from fieldkit.workflows.regions import slope_text

    corners = " ".join(f"{x:g},{y:g}" for x, y in region.vertices)
    return region.name, region.kind.name.lower(), slope_text(region), corners


def _document(region: Region) -> dict[str, Any]:
    return {
        "name": region.name,
        "kind": region.kind.name.lower(),
        "points_px": region.vertices,
        "tilt_deg": region.tilt_deg,
        "azimuth_deg": region.azimuth_deg,
        "emissivity": region.emissivity,
    }
