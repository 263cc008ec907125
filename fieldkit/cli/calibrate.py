"""``fieldkit calibrate``: emissivity, uniformity, irradiance, surface, clock as records; pose, horizon."""

from __future__ import annotations

import click

from fieldkit.cli.calibrate_clock import command as clock
from fieldkit.cli.calibrate_emissivity import command as emissivity
from fieldkit.cli.calibrate_horizon import command as horizon
from fieldkit.cli.calibrate_irradiance import command as irradiance
from fieldkit.cli.calibrate_pose import command as pose
from fieldkit.cli.calibrate_surface import command as surface
from fieldkit.cli.calibrate_uniformity import command as uniformity
from fieldkit.cli.common import CommandGroup


@click.group(cls=CommandGroup)
def command() -> None:
    """Calibrate instruments and surfaces; records in calibration/ are used in fieldkit.toml as "@name"."""


for name, subcommand in {
    "emissivity": emissivity,
    "uniformity": uniformity,
    "irradiance": irradiance,
    "surface": surface,
    "clock": clock,
    "pose": pose,
    "horizon": horizon,
}.items():
    command.add_command(subcommand, name)
