"""``fieldkit map``: tilt and azimuth of every pixel of recorded sessions, as an image and as arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli import batch, common
from fieldkit.cli.session_paths import find_sessions, latest_session
from fieldkit.cli.types import FILE, NUMBER, PATH, NumberRange
from fieldkit.model.errors import NoAnswerError

if TYPE_CHECKING:
    from fieldkit.results.batch import Failures
    from fieldkit.results.slope_map import MappedRegion, MappedSession, Maps


@click.command(cls=common.Command)
@click.argument("sessions", nargs=-1, type=PATH)
@click.option("-o", "--out", type=PATH, metavar="NAME", help="A folder for several [default: results/].")
@click.option(
    "--window",
    metavar="TIME",
    help="How far back from the last usable minute: 20m, 1h, all, or weather: as far as the regions' "
    "slopes look [default: as configured]. By the learned model no further than a day or a gap of two hours.",
)
@click.option(
    "--products",
    metavar="LIST",
    help="Add to the arrays, each with its uncertainty and an image: "
    "slope, heading, rdir, ntilt, solar, uvw, ptilt, inertia.",
)
@click.option("--limit-deg", type=NUMBER, default=math.nan, metavar="DEG", help="Tilt whose risk ptilt is.")
@click.option(
    "--drive-deg", type=NUMBER, default=math.nan, metavar="DEG", help="Direction of rdir's drive, from north."
)
@click.option("--pose", type=FILE, help="Pose of the camera, adds NAME.tif and .mcap [default: camera.pose].")
@click.option(
    "--cell-m", type=NumberRange(0, min_open=True), help="Side of NAME.tif's cells [default: as pixels are]."
)
@common.present_option
@click.option("--follow", is_flag=True, help="Map a session anew each minute while it is being recorded.")
@common.workers_options
@common.set_option
def command(
    sessions: tuple[Path, ...],
    out: Path | None,
    window: str | None,
    products: str | None,
    limit_deg: float,
    drive_deg: float,
    pose: Path | None,
    cell_m: float | None,
    present: bool,
    follow: bool,
    jobs: int | None,
    address: str | None,
    settings: tuple[str, ...],
) -> None:
    r"""Map the slopes of SESSIONS or folders of them (default: the latest), pixel by pixel.

    NAME.png shows azimuth as hue and tilt as saturation, shaded like a relief; NAME.nc (netCDF) has the
    arrays with state and likelihood region of every pixel. With --follow both are replaced as a whole, so an
    image viewer or a browser may keep them open; the recording is not disturbed. A single minute gives the
    slope along the sun alone, the product rdir. Of several sessions slope-maps.html shows the maps beside
    each other, colours and pixels of one scale. Window and settings are in the names.

    \b
    Products, NaN where there is no slope; all but ptilt with their standard uncertainty:
      slope     tilt from horizontal, degrees
      heading   azimuth of the surface normal, degrees
      rdir      slope along a drive (--drive-deg), positive uphill, degrees
      ntilt     tilt towards north, degrees
      solar     mean cosine of the sun's incidence over the day
      uvw       unit normal: east, north, up
      ptilt     P(tilt > --limit-deg), and the mean of the steepest tenth that fits
      inertia   thermal inertia by the learned model

    With a pose they (or slope and heading) are also written on the ground: NAME.tif, a cloud-optimised
    GeoTIFF with a band for each layer, and NAME.mcap, a grid map and of ptilt an occupancy grid for ROS 2.
    Needs fieldkit-slope[terrain].
    """
    from fieldkit.config.pose import read_pose
    from fieldkit.ground.terrain_products import Products
    from fieldkit.results.executors import workers
    from fieldkit.results.slope_map import ENDINGS, default_base, map_sessions, variant

    chosen = None
    if products is not None:
        chosen = Products([name.strip() for name in products.split(",")], limit_deg, drive_deg)
    camera = read_pose(pose) if pose is not None else None
    base = partial(default_base, window=window, overrides=settings)
    how: dict[str, Any] = {"window": window, "settings": settings, "present": present}
    outputs: dict[str, Any] = {"products": chosen, "pose": camera, "cell_m": cell_m, "notify": common.say}
    paths = find_sessions(sessions) if sessions else [latest_session(None)]
    if len(paths) > 1:
        if follow:
            raise click.UsageError("--follow is for one session")
        of_map = variant(window, settings)
        bases = _bases(paths, out, base, of_map)
        with workers(jobs, address, len(bases)) as executor:
            _map_many(bases, partial(map_sessions, executor=executor, **how, **outputs), out, of_map)
        return
    name = base(paths[0]) if out is None else batch.base_of(out, ENDINGS)
    map_now = partial(_map, paths[0], name, how, outputs, on_one_line=follow)
    if follow:
        _follow(paths[0], map_now)
    map_now()


def _follow(path: Path, map_now: Callable[[], None]) -> None:
    """Map at each new minute of a recording until it ends; a minute without a map is reported."""
    from fieldkit.recording.status import new_minutes

    for _ in new_minutes(path):
        try:
            map_now()
        except NoAnswerError as error:
            common.say(error.explanation)
    common.say("the recording has ended")


def _map(
    path: Path, base: Path, how: Mapping[str, Any], outputs: Mapping[str, Any], *, on_one_line: bool
) -> None:
    from fieldkit.results.slope_map import slope_map

    with batch.progress_bar("mapping") as on_progress:
        session_map = slope_map(path, **how, on_progress=on_progress)
        files = session_map.write(base, **outputs)
    for note in session_map.notes:
        common.say(note)
    if not common.print_if_json(_document(path, session_map, files), on_one_line=on_one_line):
        _print_map(session_map, files)
    if (damage := session_map.damage) is not None:
        raise damage


def _map_many(
    bases: Mapping[Path, Path], make: Callable[..., tuple[Maps, Failures]], out: Path | None, of_map: str
) -> None:
    """Map each session, and all of them on one page."""
    from fieldkit.results.maps_page import write_maps_page
    from fieldkit.results.result_files import results_folder

    with batch.progress_bar("mapping") as on_progress:
        maps, failures = make(bases, on_progress=on_progress)
    for note in dict.fromkeys(note for session_map, _ in maps.values() for note in session_map.notes):
        common.say(note)
    page = None
    if maps:
        folder = out or results_folder(next(iter(bases)))
        page = write_maps_page(
            [session_map for session_map, _ in maps.values()], folder / f"slope-maps{of_map}.html"
        )
    documents = [_document(path, *entry) for path, entry in maps.items()]
    if not common.print_if_json({"sessions": documents, "page": page}):
        for path, (session_map, files) in maps.items():
            click.echo(path.stem)
            _print_map(session_map, files)
        if page:
            click.echo(f"all maps: {page}")
    batch.raise_failures(failures, bases)


def _bases(
    paths: Sequence[Path], out: Path | None, base: Callable[[Path], Path], of_map: str
) -> dict[Path, Path]:
    """The base of each session's files, in a folder by window and settings; one named twice counts once."""
    each = dict.fromkeys(paths)
    bases = {path: out / f"{path.stem}-slope-map{of_map}" if out else base(path) for path in each}
    if len(set(bases.values())) < len(bases):
        raise click.UsageError("two sessions of one name would be written into one file: map them one by one")
    return bases


def _document(path: Path, session_map: MappedSession, files: Sequence[Path]) -> dict[str, Any]:
    return {"session": str(path), "files": [str(file) for file in files], **session_map.document()}


def _print_map(session_map: MappedSession, files: Sequence[Path]) -> None:
    """Each region of the map in numbers, and the files."""
    from fieldkit.model.confidence import percent
    from fieldkit.views.formatting import number

    if session_map.along_sun is not None:
        towards = f"tilt towards {number(session_map.along_sun.azimuth_deg)} °"
        regions = [
            (region.region, number(region.along_sun_deg, 1), region.pixels)
            for region in session_map.by_region()
        ]
        common.print_table(("region", towards, "pixels"), regions)
    else:
        of_one = f"{percent(session_map.bounds.confidence)} of one °"
        columns = ("region", "tilt °", "azimuth °", "half of pixels °", of_one, "pixels", "states")
        common.print_table(columns, map(_region_row, session_map.by_region()))
    for file in files:
        click.echo(file)


def _region_row(region: MappedRegion) -> tuple[object, ...]:
    from fieldkit.views.formatting import number

    half, of_one = _range(region.tilt_low_deg, region.tilt_high_deg), _range(*region.tilt_region_deg)
    states = ", ".join(f"{state} {share:.0%}" for state, share in region.states.items())
    angles = number(region.tilt_deg, 1), number(region.azimuth_deg, 0), half, of_one
    return (region.region, *angles, region.pixels, states)


def _range(low: float, high: float) -> str:
    from fieldkit.views.formatting import number

    return number(low, 1) if math.isnan(low) else f"{number(low, 1)} to {number(high, 1)}"
