"""``fieldkit roi``: the regions of the image, kept in ``fieldkit.toml``."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import common
from fieldkit.cli.common import campaign_file, options, print_if_json, print_json, print_table, say
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import FILE, OR_RECORD, PATH, RECT, XY, NumberRange
from fieldkit.model.errors import ConfigError

if TYPE_CHECKING:
    from fieldkit.model.site import Region
    from fieldkit.recording.requests import SentRequest
    from fieldkit.recording.suggesting import SuggestedRegion

Point = tuple[float, float]

_property_options = common.options_together(
    click.option("--target", "kind", flag_value="target", help="Its slope is estimated; the default."),
    click.option("--reference", "kind", flag_value="reference", help="Its slope is known: flat ground."),
    click.option("--foil", "kind", flag_value="foil", help="Aluminium foil: shows what the ground reflects."),
    click.option("--tilt", "tilt_deg", type=NumberRange(0, 90), help="Tilt from horizontal, degrees."),
    click.option("--azimuth", "azimuth_deg", type=NumberRange(0, 360), help="Azimuth from north, clockwise."),
    click.option("--emissivity", type=OR_RECORD, help="Emissivity in the camera's band, or its record."),
    click.option("--offset", "offset_k", type=OR_RECORD, help="Temperature offset there, K, or its record."),
)
"""What a region is for and what is measured of it, by the names of its keys in ``fieldkit.toml``."""


@click.group(cls=common.CommandGroup)
def command() -> None:
    """Manage the regions of the image: targets, and the flat reference.

    Pixels count from 0 at the top left, x to the right, y down.
    """


@command.command("add")
@click.argument("name")
@click.argument("more", nargs=-1, type=XY, metavar="[X,Y]...")
@click.option("--points", "first", type=XY, metavar="X,Y X,Y X,Y ...", help="Corners, at least three.")
@click.option("--rect", type=RECT, help="Rectangle: left, top, width, height.")
@click.option("--pose", type=FILE, help="Pose of the camera: --points are east,north in metres, drawn once.")
@click.option(
    "--ground", is_flag=True, help="The same by camera.pose; the region stays on the ground when it changes."
)
@_property_options
def add(
    name: str,
    more: tuple[Point, ...],
    first: Point | None,
    rect: tuple[float, float, float, float] | None,
    pose: Path | None,
    ground: bool,
    **properties: float | str | None,
) -> None:
    r"""Add the region NAME to fieldkit.toml.

    \b
    fieldkit roi add flat --reference --rect 6,30,32,61
    fieldkit roi add b15 --points 82,30 113,30 113,90 82,90 --tilt 15 --azimuth 180

    With --ground corners on the ground are kept, and projected into each frame by camera.pose; with --pose,
    as for fieldkit map, they are drawn where the camera sees them now. Needs fieldkit-slope[terrain], and
    width_px and height_px of the camera.

    Other keys of a region, such as surface_kind and probes, are written in fieldkit.toml.
    """
    from fieldkit.recording.redrawing import change_regions
    from fieldkit.recording.regions import add_region

    if (pose is not None or ground) and rect is not None:
        raise click.UsageError("--pose and --ground are for --points")
    if pose is not None and ground:
        raise click.UsageError("give --pose or --ground, not both")
    file = campaign_file()
    corners = [first, *more] if first else list(more)
    points = corners if pose is None else _on_frame(file, pose, corners)
    where: dict[str, Any] = {"points": points, "is_ground": ground, "rect": rect}
    addition = partial(add_region, name=name, **where, **_stated_properties(properties))
    region, reply = change_regions(file, addition)
    _print_change(file, name, {"region": region}, "added to", reply)


def _on_frame(file: Path, pose: Path, corners: list[Point]) -> list[Point]:
    """Corners on the ground as pixels of the camera's frame."""
    from fieldkit.config.pose import read_pose
    from fieldkit.ground.on_ground import on_frame
    from fieldkit.recording.regions import read_regions

    camera = read_regions(file)[0].tables.camera
    if camera is None or camera.width_px is None or camera.height_px is None:
        raise ConfigError(
            "the size of the camera's frame is not known",
            place=file,
            fix="set camera.width_px and camera.height_px",
        )
    return on_frame(read_pose(pose), (camera.height_px, camera.width_px), corners, time.time_ns())


@command.command("suggest")
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--accept", is_flag=True, help="Add all of them to fieldkit.toml.")
@click.option("--session", type=PATH, metavar="SESSION", help="Look in the first frames of this session.")
def suggest(names: tuple[str, ...], accept: bool, session: Path | None) -> None:
    r"""Suggest regions: even areas with four sharp edges that differ from their surroundings.

    \b
    fieldkit roi suggest                    list them
    fieldkit roi suggest flat bed-1         add these
    fieldkit roi suggest --accept           add all

    Frames are those of the running recording's beginning, otherwise the camera's next. The area least unlike
    the ground is suggested as reference: check that it is level. Give targets their slopes by roi edit.
    """
    from fieldkit.recording.redrawing import change_regions
    from fieldkit.recording.suggesting import add_suggested, suggest_regions

    if accept and names:
        raise click.UsageError("give names or --accept, not both")
    file = campaign_file()
    suggested_regions = suggest_regions(file.parent, find_session(session) if session else None)
    chosen = [suggestion for suggestion in suggested_regions if accept or suggestion.region.name in names]
    if unknown := set(names) - {suggestion.region.name for suggestion in suggested_regions}:
        names_text = ", ".join(suggestion.region.name for suggestion in suggested_regions)
        place = ", ".join(sorted(unknown))
        raise ConfigError("not suggested", place=place, fix=f"choose from those suggested: {names_text}")
    reply = change_regions(file, partial(add_suggested, suggestions=chosen))[1] if chosen else None
    added = [suggestion.region.name for suggestion in chosen]
    if options().json:
        suggestions = [suggestion.document() for suggestion in suggested_regions]
        print_json({"config": str(file), "suggestions": suggestions, "added": added, **_request(reply)})
    elif not chosen:
        print_table(_SUGGESTED, [_suggested_row(suggestion) for suggestion in suggested_regions])
        say("next: fieldkit roi suggest --accept, or with the names of those to add")
    if chosen:
        say(f"{', '.join(added)} added to {file}; check with a spirit level that the reference is level")
        _say_sent(reply)
        say(f"next: fieldkit roi edit {added[-1]} --tilt DEGREES --azimuth DEGREES")


@command.command("edit")
@click.argument("name")
@click.option("--shrink", type=NumberRange(0, min_open=True), metavar="PX", help="Move every edge inwards.")
@_property_options
def edit(name: str, shrink: float | None, **properties: float | str | None) -> None:
    """Change the region NAME in fieldkit.toml: its size, its kind or its measured properties.

    A running recording uses the change from the next full minute on, but keeps its offsets. Finished sessions
    keep the regions they were recorded with; with --campaign, estimate, report and map use the new ones.
    """
    from fieldkit.recording.redrawing import change_regions
    from fieldkit.recording.regions import edit_region

    file, edits = campaign_file(), _stated_properties(properties)
    changes, reply = change_regions(file, partial(edit_region, name=name, shrink_px=shrink, **edits))
    _print_change(file, name, {"region": {"name": name, **changes}}, "changed in", reply)


@command.command("remove")
@click.argument("name")
def remove(name: str) -> None:
    """Remove the region NAME from fieldkit.toml."""
    from fieldkit.config.edit import remove_region
    from fieldkit.recording.redrawing import change_regions

    file = campaign_file()
    _, reply = change_regions(file, partial(remove_region, name=name))
    _print_change(file, name, {"removed": name}, "removed from", reply)


@command.command("list")
def list_() -> None:
    """List the regions."""
    from fieldkit.config.toml_schema import RegionOutline
    from fieldkit.recording.regions import read_regions

    regions = read_regions(campaign_file())[0].regions
    if options().json:
        print_json({"regions": [RegionOutline.of(region).model_dump() for region in regions]})
    elif regions:
        print_table(("name", "kind", "tilt/azimuth", "corners"), [_row(region) for region in regions])
    else:
        say("no regions yet: fieldkit roi add")


@command.command("check")
@click.option("--session", type=PATH, metavar="SESSION", help="Check against the frames of this session.")
@click.pass_context
def check(ctx: click.Context, session: Path | None) -> None:
    """Check size, overlap and position of every region; with --session also temperature spread and edges.

    Exit code 3 if a region is unusable.
    """
    from fieldkit.recording.regions import inspect_regions, read_regions

    config, mistakes = read_regions(campaign_file())
    inspections = inspect_regions(config, find_session(session) if session else None)
    failed = bool(mistakes) or any(inspection.level == "FAIL" for inspection in inspections)
    documents = [inspection.document() for inspection in inspections]
    if not print_if_json({"regions": documents, "mistakes": mistakes, "ok": not failed}):
        print_table(
            ("name", "tilt/azimuth", "pixels", "spread", ""), [inspection.row() for inspection in inspections]
        )
        for mistake in mistakes:
            click.echo(f"FAIL: {mistake}")
    ctx.exit(ConfigError.exit_code if failed else 0)


def _print_change(
    file: Path, name: str, changed: Mapping[str, Any], how: str, sent: SentRequest | None
) -> None:
    print_if_json({"config": str(file), **changed, **_request(sent)})
    say(f"region {name} {how} {file}")
    _say_sent(sent)
    _report_issues(file, name)


def _request(sent: SentRequest | None) -> dict[str, str]:
    return {} if sent is None else {"session": str(sent.session), "request": sent.id}


def _say_sent(sent: SentRequest | None) -> None:
    if sent is not None:
        say(f"sent to the recording {sent.session.name}, which uses it from the next full minute on")
        if sent.unused:
            common.say_warning(
                f"{', '.join(sent.unused)}: used from the next recording on; "
                f"of this one: fieldkit estimate {sent.session.name} --campaign, once it is sealed"
            )


def _stated_properties(properties: Mapping[str, float | str | None]) -> dict[str, Any]:
    return {key: value for key, value in properties.items() if value is not None}


def _report_issues(file: Path, name: str) -> None:
    """Print at once why the region, or the regions together, cannot be used as they are now."""
    from fieldkit.recording.regions import inspect_regions, read_regions

    config, mistakes = read_regions(file)
    for mistake in mistakes:
        common.say_warning(mistake)
    for inspection in inspect_regions(config):
        if inspection.region.name == name and inspection.level != "ok":
            issues = "; ".join(inspection.issues)
            say(f"  {name}: {inspection.pixels} px; {issues}; see fieldkit roi check")


def _row(region: Region) -> tuple[str, ...]:
    from fieldkit.estimation.region_check import slope_text

    corners = " ".join(f"{x:g},{y:g}" for x, y in region.points_px)
    return region.name, region.kind.name.lower(), slope_text(region), corners


_SUGGESTED = ("name", "kind", "pixels", "contrast", "spread", "corners")


def _suggested_row(suggestion: SuggestedRegion) -> tuple[str, ...]:
    name, kind, _, corners = _row(suggestion.region)
    match = suggestion.area
    return name, kind, f"{match.pixels} px", f"{match.contrast_k:.1f} K", f"{match.spread_k:.2f} K", corners
