"""``fieldkit calibrate emissivity``: from a recorded session, or with the instruments at hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.calibration.emissivity import FOIL_EMISSIVITY, FOIL_EMISSIVITY_SD
from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import DURATION, RECORD_NAME
from fieldkit.model.units import CELSIUS_ZERO_K

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fieldkit.calibration.calibration_record import Source
    from fieldkit.calibration.emissivity import Emissivity, Pairs, SharedUncertainties
    from fieldkit.cli.calibrate_gather import Setup

METHODS = {True: "reference emissivity (tape), ASTM E1933", False: "contact thermometer, ASTM E1933"}


@click.command(cls=common.Command)
@click.argument("session", required=False, type=click.Path(path_type=Path))
@click.option(
    "--sample", type=RECORD_NAME, required=True, metavar="NAME", help="What it is; names the record."
)
@click.option("--region", metavar="NAME", help="The sample in the picture [default: the reference].")
@click.option("--thermometer", metavar="STREAM", help="If there are several.")
@click.option("--channel", metavar="PROBE", help="Which probe, by name or number [default: the first].")
@click.option(
    "--reflected",
    default="foil",
    show_default=True,
    metavar="REGION|°C|free",
    help="What the sample mirrors: a foil's region, a temperature, or to be found.",
)
@click.option("--tape", metavar="REGION", help="Tape or paint of known emissivity instead of a thermometer.")
@click.option("--tape-emissivity", type=click.FloatRange(0.5, 1), default=0.95, show_default=True)
@click.option(
    "--tape-sd", type=click.FloatRange(0.001), default=0.01, show_default=True, help="Its uncertainty."
)
@click.option(
    "--foil-emissivity",
    type=click.FloatRange(0, 0.5),
    default=FOIL_EMISSIVITY,
    show_default=True,
    help="What the foil emits itself, at the surface's temperature.",
)
@click.option(
    "--foil-sd",
    type=click.FloatRange(0),
    default=FOIL_EMISSIVITY_SD,
    show_default=True,
    help="Standard uncertainty of the foil's emissivity.",
)
@click.option(
    "--band",
    default="8-14",
    show_default=True,
    metavar="8-14|FILE.csv|B,F|R,B,F,O",
    help="What the camera sees: flat, a response, or the camera's constants.",
)
@click.option(
    "--camera-emissivity", type=click.FloatRange(0.05, 1), help="That the camera has applied itself."
)
@click.option("--camera-reflected", type=float, default=20.0, show_default=True, metavar="°C")
@click.option(
    "--distance", type=click.FloatRange(0), default=0.0, metavar="M", help="Metres of air, if above a few."
)
@click.option(
    "--air", type=float, default=20.0, show_default=True, metavar="°C", help="Of the air in between."
)
@click.option("--humidity", type=click.FloatRange(0, 100), default=50.0, show_default=True, metavar="%")
@click.option("--angle", type=click.FloatRange(0, 90), metavar="DEG", help="Of the camera from the normal.")
@click.option(
    "--unit", type=click.Choice(["C", "F"]), default="C", help="What the thermometer really showed."
)
@click.option("--camera-sd", type=click.FloatRange(0), default=0.3, show_default=True, metavar="K")
@click.option("--thermometer-sd", type=click.FloatRange(0), default=0.3, show_default=True, metavar="K")
@click.option(
    "--probe-sd",
    type=click.FloatRange(0),
    default=0.5,
    show_default=True,
    metavar="K",
    help="Of probe to skin, 0.3 K per millimetre of sand.",
)
@click.option("--reflected-sd", type=click.FloatRange(0), default=5.0, show_default=True, metavar="K")
@click.option(
    "--probe-gradient-sd",
    type=click.FloatRange(0),
    default=0.3,
    show_default=True,
    metavar="K",
    help="Half of what the probe's error changes by from the coldest pair to the warmest.",
)
@click.option(
    "--sky-drift-sd",
    type=click.FloatRange(0),
    default=5.0,
    show_default=True,
    metavar="K",
    help="The same of the sky, where no foil follows it.",
)
@click.option(
    "--temperatures",
    type=click.IntRange(3),  # fewer pairs cannot show whether they agree: emissivity_refusals.MIN_PAIRS
    default=3,
    show_default=True,
    help="With instruments: stop after so many steady temperatures, 5 K apart, and with --reflected free "
    "not before they span 15 K.",
)
@click.option(
    "--for", "lasting", type=DURATION, metavar="TIME", help="With instruments: stop after this time: 3h, 90m."
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context, /, session: Path | None, sample: str, settings: tuple[str, ...], **given: Any
) -> None:
    r"""Find the emissivity of a sample in the camera's band.

    With a SESSION it is worked out from that; without one the campaign's instruments are recorded until
    enough steady temperatures have been seen (Ctrl-C ends earlier), and the same is done with the recording.

    \b
    fieldkit calibrate emissivity --sample dry-silica-sand --region flat --reflected foil
    fieldkit calibrate emissivity recordings/X.h5 --sample dry-silica-sand --reflected -42
    """
    if session is None:
        from fieldkit.cli.calibrate_emissivity_live import record_emissivity

        session = record_emissivity(ctx, sample, given, settings)
        settings = ()  # the recording has them
    work_out(find_session(ctx, session), sample, given, settings)


def work_out(session: Path, sample: str, given: dict[str, Any], settings: Sequence[str] = ()) -> Path:
    """Find, save and tell the emissivity that a session holds; the record's path."""
    from fieldkit.calibration.steady_pairs import (
        pairs_of,
        refuse_other_bed,
        refuse_shifted_clocks,
        steady_stretches,
    )
    from fieldkit.cli.calibrate_gather import Gathering
    from fieldkit.cli.calibrate_setup import setup_of
    from fieldkit.cli.calibrating import finish, moment, source_of
    from fieldkit.sessions.reader import open_session
    from fieldkit.workflows.sources import config_for

    with open_session(session) as opened:
        config = config_for(opened, settings)
        setup = setup_of(tuple(opened.streams.values()), opened.regions or config.regions, given, session)
        gathering = Gathering(setup)
        for one in opened.samples():
            gathering.add(one)
        date = moment(opened)
        common.say_damage(opened)
    readings = gathering.readings()
    if setup.tape is None:
        refuse_shifted_clocks(readings)
        refuse_other_bed(readings, gathering.other_probes_k(), setup.channel_names[setup.channel])
    pairs, remarks = pairs_of(steady_stretches(readings))
    found = fit(pairs, setup, given)
    found = replace(found, remarks=(*remarks, *found.remarks))
    record = record_of(sample, date, found, pairs, setup, given, source_of(session))
    headline = (
        f"emissivity {found.value:.3f} ± {found.expanded:.3f} (k=2)   band {setup.band.label}   "
        f"residual {found.residual_k:.2f} K   n={len(pairs)}   span {_span(pairs)}"
    )
    path = finish(record, config, headline, f'surface.emissivity = "@{sample}"')
    draw(path, found, pairs, setup)
    return path


def fit(pairs: Pairs, setup: Setup, given: dict[str, Any]) -> Emissivity:
    """The fit as the options ask for it."""
    from fieldkit.calibration.emissivity import fit_emissivity

    is_free = given["reflected"] == "free"
    return fit_emissivity(
        pairs,
        shared_of(given),
        reflected="free" if is_free else "fixed",
        band=setup.band,
        tape_emissivity=setup.tape_emissivity,
        tape_emissivity_sd=given["tape_sd"] if setup.tape is not None else 0.0,
        foil_emissivity_sd=given["foil_sd"] if setup.foil is not None else 0.0,
    )


def shared_of(given: dict[str, Any]) -> SharedUncertainties:
    """Uncertainties that all pairs share, as given."""
    from fieldkit.calibration.emissivity import SharedUncertainties

    return SharedUncertainties(
        camera_k=given["camera_sd"],
        thermometer_k=given["thermometer_sd"],
        probe_to_skin_k=given["probe_sd"],
        reflected_k=given["reflected_sd"],
        sky_drift_k=given["sky_drift_sd"],
        probe_gradient_k=given["probe_gradient_sd"],
    )


def record_of(
    sample: str,
    date: Any,
    found: Emissivity,
    pairs: Pairs,
    setup: Setup,
    given: dict[str, Any],
    source: Source,
) -> Any:
    """The record of an emissivity."""
    from fieldkit.calibration.calibration_record import CalibrationRecord, instrument_of
    from fieldkit.cli.calibrating import told_settings

    celsius = {
        "contact_c": pairs.contact_k, "apparent_c": pairs.apparent_k, "reflected_c": pairs.reflected_k
    }  # fmt: skip
    how = {"foil": setup.foil is not None, "free": given["reflected"] == "free"}
    details = {
        "temperature_range_c": [
            round(float(k) - CELSIUS_ZERO_K, 3) for k in (pairs.contact_k.min(), pairs.contact_k.max())
        ],
        "reflected_temperature_c": round(found.reflected_k - CELSIUS_ZERO_K, 3),
        "reflected_by": "foil, ISO 18434-1" if how["foil"] else "fitted" if how["free"] else "given",
        "pairs": len(pairs),
        "chi_square": found.chi_square,
        "residual_k": found.residual_k,
        "effective_degrees_of_freedom": found.effective_freedom,
        **{key: [round(float(k) - CELSIUS_ZERO_K, 3) for k in values] for key, values in celsius.items()},
    }
    return CalibrationRecord(
        "emissivity", sample, date, found.value, found.standard_uncertainty, "1",
        METHODS[setup.tape is not None], found.freedom, found.budget, band=setup.band.label,
        angle_deg=math.nan if given["angle"] is None else given["angle"],
        instrument=instrument_of(setup.camera), sources=(source,), details=details,
        settings=told_settings({"sample": sample, **given}), remarks=found.remarks,
    )  # fmt: skip


def _span(pairs: Pairs) -> str:
    low, high = pairs.contact_k.min() - CELSIUS_ZERO_K, pairs.contact_k.max() - CELSIUS_ZERO_K
    return f"{low:.1f}→{high:.1f} °C"


def draw(record: Path, found: Emissivity, pairs: Pairs, setup: Setup) -> None:
    """The picture beside the record, where matplotlib is installed."""
    from fieldkit.views.calibration_figure import emissivity_svg
    from fieldkit.views.plotting import available

    if available():
        record.with_suffix(".svg").write_text(emissivity_svg(found, pairs, setup.band), encoding="utf-8")
