"""``fieldkit calibrate horizon``: a horizon from a DEM, the skyline of a frame, or beds that shade others."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import click

from fieldkit.cli import common
from fieldkit.cli.types import FILE, FRAME, MOMENT, NEW_FILE, NUMBER, number_option


@click.command(cls=common.Command)
@click.option("--dem", type=FILE, help="GeoTIFF of heights.")
@click.option("--crs", help="Projected system of the DEM in metres, such as EPSG:32654.")
@click.option(
    "--place", type=(NUMBER, NUMBER), metavar="EAST NORTH", help="Place of the regions in the DEM, in metres."
)
@number_option("--nearest-m", "nearest_m", 0.0, "Nearer ground is omitted.")
@click.option("--skyline", type=FILE, help="CSV file of pixels on the skyline: x_px, y_px.")
@click.option("--pose", "pose_file", type=FILE, help="Pose of the camera that saw them.")
@click.option("--at", "moment", type=MOMENT, help="When, if the camera moves [default: now].")
@click.option("--frame", "shape", type=FRAME, help="Size of its frame: 160x120.")
@click.option(
    "--regions", is_flag=True, help="Regions with points_m: where each one's neighbours rise above it."
)
@click.option("-o", "--out", type=NEW_FILE, default="horizon.csv", show_default=True, help="File to write.")
def command(
    dem: Path | None, crs: str | None, place: tuple[float, float] | None, nearest_m: float,
    skyline: Path | None, pose_file: Path | None, moment: datetime | None, shape: tuple[int, int] | None,
    regions: bool, out: Path,
) -> None:  # fmt: skip
    r"""Find the horizon of a place from a DEM, from pixels on the skyline of a frame, or by other regions.

    The file that it writes is named in fieldkit.toml: horizon = "horizon.csv", under [site] or of a region.
    With --regions, horizon-REGION.csv is written for each region that another one shades, together with the
    site's horizon, and named in fieldkit.toml. Needs fieldkit-slope[terrain].

    \b
    fieldkit calibrate horizon --dem dem.tif --crs EPSG:32654 --place 354605 3936221
    fieldkit calibrate horizon --skyline clicks.csv --pose pose.toml --frame 160x120
    fieldkit calibrate horizon --regions
    """
    if regions:
        if dem or skyline:
            raise click.UsageError("--regions stands alone")
        _write_horizons_of_regions()
        return
    from fieldkit.calibrate.horizon import horizon_from_dem, horizon_from_skyline, write_horizon

    if dem and crs and place and not skyline:
        skyline_horizon = horizon_from_dem(dem, crs, *place, nearest_m=nearest_m)
    elif skyline and pose_file and shape and not dem:
        skyline_horizon = horizon_from_skyline(skyline, pose_file, shape, at=moment)
    else:
        raise click.UsageError(
            "give --dem, --crs and --place, or --skyline, --pose and --frame, or --regions"
        )
    write_horizon(out, skyline_horizon)
    highest = max(skyline_horizon, key=lambda pair: pair[1])
    if common.print_if_json({"file": str(out), "horizon": skyline_horizon}):
        return
    click.echo(f"highest {highest[1]:.1f}° at azimuth {highest[0]:.0f}°")
    click.echo(f"wrote {out}")
    common.say(f'next: horizon = "{out.name}" in fieldkit.toml, under [site] or of a region')


def _write_horizons_of_regions() -> None:
    from fieldkit.calibrate.horizon import horizons_of_regions, set_horizons

    config = common.campaign()
    horizons = horizons_of_regions(config)
    files = set_horizons(config.path, horizons)
    if common.print_if_json({"files": list(map(str, files)), "horizons": horizons}):
        return
    for (name, horizon), path in zip(horizons.items(), files, strict=True):
        azimuth, elevation = max(horizon, key=lambda pair: pair[1])
        click.echo(f"{name}: highest {elevation:.1f}° at azimuth {azimuth:.0f}°, {path.name}")
    if not horizons:
        click.echo("no region rises above another")
