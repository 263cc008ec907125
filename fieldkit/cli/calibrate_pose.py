"""``fieldkit calibrate pose``: where the camera stands and looks, from ground points marked in its frame."""

from __future__ import annotations

from pathlib import Path

import click

from fieldkit.cli import common
from fieldkit.cli.types import FILE, FRAME, LENS, NEW_FILE, NUMBER, number_option


@click.command(cls=common.Command)
@click.argument("points", type=FILE)
@click.option("--crs", required=True, help="Projected system of the points in metres, such as EPSG:32654.")
@click.option("--frame", "shape", type=FRAME, required=True, help="Size of the camera's frame: 160x120.")
@number_option(
    "--hfov-deg", "hfov_deg", None, "Horizontal field of view [default: found as well].", metavar="DEG"
)
@number_option("--mark-sd-px", "mark_sd_px", 1.0, "Standard uncertainty of a mark.", metavar="PX")
@click.option("--distortion", type=LENS, default=(), help="Of the lens, as OpenCV's calibration gives it.")
@click.option("--range-m", type=NUMBER, default=100.0, show_default=True, help="Farther ground is omitted.")
@click.option("--ground-m", type=NUMBER, metavar="M", help="Height of level ground; or give --dem.")
@click.option("--dem", metavar="FILE", help="GeoTIFF of heights, by its path from the folder of the pose.")
@click.option("-o", "--out", type=NEW_FILE, default="pose.toml", show_default=True, help="File to write.")
def command(
    points: Path, crs: str, shape: tuple[int, int], hfov_deg: float | None, mark_sd_px: float, range_m: float,
    ground_m: float | None, dem: str | None, out: Path, distortion: tuple[float, ...],
) -> None:  # fmt: skip
    r"""Find the pose of a camera from four or more surveyed POINTS marked in a frame.

    POINTS is a CSV file with the columns x_px, y_px, east_m, north_m, height_m; pixel centres are at whole
    numbers, as on the axes of every image that fieldkit draws. The pose goes to a file for fieldkit map
    --pose. Needs fieldkit-slope[terrain].

    \b
    fieldkit calibrate pose points.csv --crs EPSG:32654 --frame 160x120 --ground-m 12.5
    """
    from fieldkit.calibrate.pose import pose
    from fieldkit.views.formatting import number

    if (ground_m is None) == (dem is None):
        raise click.UsageError("give one of --ground-m, --dem")
    camera_pose = pose(points, crs, shape, hfov_deg=hfov_deg, mark_sd_px=mark_sd_px, distortion=distortion)
    camera_pose.write(out, range_m=range_m, ground_m=ground_m, dem=dem)
    residuals = [float(residual) for residual in camera_pose.fit.residuals_px]
    fit = {"pose": camera_pose.values, "sd": camera_pose.fit.sd, "residuals_px": residuals}
    if common.print_if_json({"file": str(out), **fit}):
        return
    rows = [
        (name, number(value, 3), number(camera_pose.fit.sd[name], 3))
        for name, value in camera_pose.values.items()
    ]
    common.print_table(("", "pose", "standard uncertainty"), rows)
    click.echo(f"marks off by {max(residuals):.1f} px at most")
    click.echo(f"the grid of {crs} is corrected: {camera_pose.grid}")
    click.echo(f"wrote {out}")
    common.say(f'next: fieldkit map --pose {out}, or pose = "{out}" under [camera] in fieldkit.toml')
