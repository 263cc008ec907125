"""``fieldkit calibrate emissivity``: from a recorded session, or with the instruments at hand."""

from __future__ import annotations

import signal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.calibration.foil import FOIL_EMISSIVITY, FOIL_EMISSIVITY_SD
from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import DURATION, PATH, RECORD_NAME, argument_range, number_option

if TYPE_CHECKING:
    from fieldkit.calibrate import MeasurementOptions


_kelvin = partial(number_option, metavar="K")
"""An option for a standard uncertainty."""


# options whose values go into `MeasurementOptions`: the second name is that of its field
@click.command(cls=common.Command)
@click.argument("session", required=False, type=PATH)
@click.option("--sample", type=RECORD_NAME, required=True, help="Name of the sample and of the record.")
@click.option("--region", metavar="REGION", help="Region of the sample [default: the reference].")
@click.option("--thermometer", metavar="STREAM", help="Thermometer, if there are several.")
@click.option(
    "--channel", metavar="PROBE", help="Probe, by name or number [default: the region's own, or the first]."
)
@click.option(
    "--reflected",
    default="foil",
    show_default=True,
    metavar="REGION|°C|free",
    help="Reflected temperature: a foil's region, a temperature, or free to fit it.",
)
@click.option("--tape", metavar="REGION", help="Tape or paint of known emissivity instead of a thermometer.")
@number_option("--tape-emissivity", "tape_emissivity", 0.95, "Emissivity of the tape.")
@number_option("--tape-sd", "tape_sd", 0.01, "Standard uncertainty of the tape's emissivity.")
@number_option(
    "--foil-emissivity", "foil_emissivity", FOIL_EMISSIVITY, "Emissivity of the foil, as warm as the surface."
)
@number_option("--foil-sd", "foil_sd", FOIL_EMISSIVITY_SD, "Standard uncertainty of the foil's emissivity.")
@click.option(
    "--band",
    default="8-14",
    show_default=True,
    metavar="8-14|FILE.csv|B,F|R,B,F,O",
    help="Spectral band of the camera: flat, a response, or the camera's constants.",
)
@number_option("--camera-emissivity", "camera_emissivity", None, "Emissivity already applied by the camera.")
@number_option(
    "--camera-reflected", "camera_reflected_c", 20.0, "Reflected temperature it has applied.", metavar="°C"
)
@click.option(
    "--distance",
    "distance_m",
    type=argument_range("distance_m"),
    default=0.0,
    metavar="M",
    help="Path through the air, if above a few metres.",
)
@number_option("--air", "air_c", 20.0, "Air temperature along the path.", metavar="°C")
@number_option("--humidity", "humidity_percent", 50.0, "Relative humidity along the path.", metavar="%")
@number_option("--angle", "angle_deg", None, "Viewing angle from the surface normal.", metavar="DEG")
@click.option(
    "--unit", type=click.Choice(["C", "F"]), default="C", help="Unit the thermometer really displayed."
)
@_kelvin("--camera-sd", "camera_sd_k", 0.3, "Standard uncertainty of the camera.")
@_kelvin("--thermometer-sd", "thermometer_sd_k", 0.3, "Standard uncertainty of the thermometer.")
@_kelvin("--probe-sd", "probe_sd_k", 0.5, "Between probe and surface: 0.3 K per millimetre of sand.")
@_kelvin("--reflected-sd", "reflected_sd_k", 5.0, "Standard uncertainty of the reflected temperature.")
@_kelvin(
    "--probe-gradient-sd", "probe_gradient_sd_k", 0.25, "Half the probe's change of error over the pairs."
)
@_kelvin("--sky-drift-sd", "sky_drift_sd_k", 3.0, "Half a sky's change over the pairs, without a foil.")
@click.option(
    "--temperatures",
    type=click.IntRange(3),  # fewer pairs cannot show whether they agree: emissivity.MIN_PAIRS
    default=3,
    show_default=True,
    help="With instruments: stop after this many steady temperatures, 5 K apart; with --reflected free "
    "not before they span 15 K.",
)
@click.option("--for", "duration", type=DURATION, help="With instruments: stop after this time: 3h, 90m.")
@common.set_option
def command(session: Path | None, sample: str, settings: tuple[str, ...], **fields: Any) -> None:
    r"""Find the emissivity of a sample in the camera's band.

    With a SESSION it is found from that; without one the campaign's instruments are recorded until enough
    steady temperatures have been seen (Ctrl-C ends earlier), and the recording is used.

    \b
    fieldkit calibrate emissivity --sample dry-silica-sand --region flat --reflected foil
    fieldkit calibrate emissivity recordings/X.h5 --sample dry-silica-sand --reflected -42
    """
    from fieldkit import calibrate
    from fieldkit.cli.calibration_output import save_and_print

    options = calibrate.MeasurementOptions(**fields)
    if session is None:
        session = _record(sample, options, settings)
        settings = ()  # the recording contains them
    path, notify = find_session(session), common.say_warning
    save_and_print(
        calibrate.emissivity(path, sample=sample, options=options, settings=settings, notify=notify)
    )


def _record(sample: str, options: MeasurementOptions, settings: tuple[str, ...]) -> Path:
    """Record until enough steady temperatures were seen, the time is over, or Ctrl-C; the session."""
    from fieldkit.calibrate.emissivity_live import BURSTS, prepare_emissivity
    from fieldkit.cli.recording import run_until_stopped

    config = common.campaign((*BURSTS, *settings))
    with prepare_emissivity(config, sample, options, common.say_warning) as prepared:
        _confirm_setup(prepared.steps)
        # SIGTERM ends it as fieldkit stop does: the recorder seals the session
        view = prepared.view(common.say, partial(signal.raise_signal, signal.SIGTERM))
        recording = run_until_stopped(prepared.recording.starting_now(), [view])
    recording.raise_failure()
    common.say(f"recorded {recording.path}")
    return recording.path


def _confirm_setup(steps: str) -> None:
    """Print what to place where; wait for a key if there is a terminal."""
    common.say(steps)
    if common.is_interactive():
        click.pause("press a key when both are in place", err=True)
