"""``fieldkit calibrate surface``: the scale kappa from beds of known slope, and what else they tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import RECORD_NAME
from fieldkit.model.errors import CalibrationError, ConfigError

if TYPE_CHECKING:
    from fieldkit.calibration.surface_scale import BedScale
    from fieldkit.estimation.balance import Rows
    from fieldkit.estimation.bins import History
    from fieldkit.estimation.estimator import Estimator
    from fieldkit.estimation.scale import ExchangeFit
    from fieldkit.physics.facet import FloatArray

LEAST_TILT_DEG = 3.0
CLOUDY = ("CLOUD", "LOW_SUN", "MOVED")


@click.command(cls=common.Command)
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--name", type=RECORD_NAME, default="beds", show_default=True, help="Names the record.")
@click.option("--bed", "beds", multiple=True, metavar="REGION", help="Only this bed; may be repeated.")
@click.option(
    "--tilt-sd",
    type=click.FloatRange(0, min_open=True),
    default=0.5,
    show_default=True,
    metavar="DEG",
    help="Of the inclinometer.",
)
@common.set_option
@click.pass_context
def command(
    ctx: click.Context,
    /,
    session: Path,
    name: str,
    beds: tuple[str, ...],
    tilt_sd: float,
    settings: tuple[str, ...],
) -> None:
    r"""The scale kappa of a SESSION from its beds of known tilt and azimuth.

    kappa is for this model of the surface and this irradiance: change neither after calibrating.

    \b
    fieldkit calibrate surface recordings/X.h5 --bed b15
    """
    from fieldkit.calibration.calibration_record import CalibrationRecord
    from fieldkit.calibration.surface_scale import pool
    from fieldkit.cli.calibrating import finish, moment, source_of
    from fieldkit.sessions.reader import open_session
    from fieldkit.workflows.estimate import estimator_for, minutes_of
    from fieldkit.workflows.sources import config_for

    session = find_session(ctx, session)
    with open_session(session) as opened:
        # kappa is measured against one, whatever was configured
        config = config_for(opened, (*settings, "estimator.scale=1.0"))
        estimator = estimator_for(opened, config)
        for _ in minutes_of(opened, estimator):
            pass
        date = moment(opened)
        common.say_damage(opened)
    chosen = known_beds(estimator, beds, session)
    rows, history = rows_of(estimator)
    scales = {bed: scale_of(rows, index, slope, tilt_sd) for bed, (index, slope) in chosen.items()}
    found = pool(scales, tilt_sd)
    told = identified(estimator, history, [slope for _, slope in chosen.values()], list(chosen))
    settings_used = estimator.settings
    record = CalibrationRecord(
        "surface", name, date, found.kappa, found.standard_uncertainty, "1",
        f"beds of known slope, {settings_used.model} model", found.freedom, found.budget,
        values={bed: scale.kappa for bed, scale in scales.items()},
        uncertainties={bed: scale.kappa_sd for bed, scale in scales.items()}, sources=(source_of(session),),
        details=_details(told, estimator.irradiance_model),
        settings={"name": name, "beds": list(chosen), "tilt_sd": tilt_sd}, remarks=(told.says,),
    )  # fmt: skip
    each = "   ".join(f"{bed} {scale.kappa:.3f}" for bed, scale in scales.items())
    headline = (
        f"kappa {found.kappa:.3f} ± {found.expanded:.3f} (k=2)   {settings_used.model} model, "
        f"{estimator.irradiance_model}\n  {each}"
    )
    finish(record, config, headline, f'estimator.scale = "@{name}"')


def rows_of(estimator: Estimator) -> tuple[Rows, History]:
    """Rows of all clear minutes of a session for all its targets, with their history."""
    from fieldkit.estimation import balance
    from fieldkit.estimation.bins import History, RegionColumns
    from fieldkit.estimation.region_temperatures import remove_offsets
    from fieldkit.model.samples import Quality

    history, field, settings = (
        History.of(estimator.bins),
        RegionColumns(estimator.regions),
        estimator.settings,
    )
    true = remove_offsets(history, field.regions, settings)
    rows = balance.least_squares_rows(true, 0, field, settings)
    doubtful = sum(int(Quality[name]) for name in CLOUDY)
    return replace(rows, y=np.where((history.flags & doubtful)[:, np.newaxis] == 0, rows.y, np.nan)), history


def known_beds(
    estimator: Estimator, beds: Sequence[str], where: Path
) -> dict[str, tuple[int, tuple[float, float]]]:
    """Column and slope of the targets whose slope is known; raises `ConfigError` for one that is not.

    Raises `CalibrationError` where none is.
    """
    from fieldkit.model.site import RegionKind

    targets = [region for region in estimator.regions if region.kind is RegionKind.TARGET]
    known = {
        region.name: (index, (region.tilt_deg, region.azimuth_deg))
        for index, region in enumerate(targets)
        if np.isfinite(region.tilt_deg)
        and np.isfinite(region.azimuth_deg)
        and region.tilt_deg >= LEAST_TILT_DEG
    }
    for bed in beds:
        if bed not in known:
            raise ConfigError(
                f"{where}: {bed} is no bed of known slope",
                fix=f"known are {', '.join(known) or 'none'}; give tilt_deg",
            )
    if not known:
        raise CalibrationError(
            f"{where} has no bed of known slope",
            fix="give tilt_deg and azimuth_deg of one bed of 10 to 25 degrees",
        )
    return {name: value for name, value in known.items() if not beds or name in beds}


def scale_of(rows: Rows, index: int, slope: tuple[float, float], tilt_sd_deg: float) -> BedScale:
    """The scale of one bed."""
    from fieldkit.calibration.surface_scale import BedScale
    from fieldkit.estimation.scale import scale_from_known_bed
    from fieldkit.physics.facet import normal

    tilt, azimuth = slope
    y, sigma = rows.y[:, index], rows.sigma[:, index]
    lit = np.isfinite(rows.design).all(axis=1) & np.isfinite(sigma)
    given = rows.design[lit], y[lit], sigma[lit], rows.reference
    found = scale_from_known_bed(*given, normal(tilt, azimuth))
    steeper = scale_from_known_bed(*given, normal(tilt + tilt_sd_deg, azimuth))
    return BedScale(found.kappa, found.kappa_sd, steeper.kappa - found.kappa)


def identified(
    estimator: Estimator, history: History, slopes: Sequence[tuple[float, float]], names: Sequence[str]
) -> ExchangeFit:
    """What the known beds tell of alpha and beta of eq. (6)."""
    from fieldkit.estimation.bins import RegionColumns
    from fieldkit.estimation.scale import identify
    from fieldkit.physics.facet import normal

    field, surface = RegionColumns(estimator.regions), estimator.settings.surface
    columns = [next(i for i, one in enumerate(estimator.regions) if one.name == name) for name in names]
    base = history.temperature_k[:, field.references]
    reference = np.where(np.isfinite(base), base, 0.0).sum(axis=1) / np.isfinite(base).sum(axis=1).clip(1)
    reference = np.where(np.isfinite(base).any(axis=1), reference, np.nan)
    reference_normal = field.reference_normals.mean(axis=0)
    warm = np.concatenate([history.temperature_k[:, column] for column in columns])
    light = np.concatenate([_more_light(history, normal(*slope), reference_normal) for slope in slopes])
    cold = np.tile(reference, len(columns))
    known = np.isfinite(warm) & np.isfinite(light) & np.isfinite(cold)
    if known.sum() < len(columns) * 3:
        raise CalibrationError("too few minutes with light and temperatures", fix="take a longer session")
    given, prior = (warm[known], cold[known], light[known]), (surface.alpha, surface.beta)
    first = identify(*given, estimator.settings.noise_k, prior)
    # what the surface does beside eq. (6) counts as noise too, or the split would look measured
    left_k = given[0] - given[1] - given[2] / first.steepness_w_m2_k
    noise_k = max(estimator.settings.noise_k, float(np.std(left_k)) / np.sqrt(2.0))
    return identify(*given, noise_k, prior)


def _more_light(history: History, bed: FloatArray, reference: FloatArray) -> FloatArray:
    """Direct light (n,) of a bed beyond the reference's, W/m2; NaN while one is in its own shade."""
    from fieldkit.estimation.methods import LOWEST_COS_INCIDENCE

    on_bed, on_reference = history.sun @ bed, history.sun @ reference
    lit = np.minimum(on_bed, on_reference) >= LOWEST_COS_INCIDENCE
    return np.where(lit, history.dni_w_m2 * (on_bed - on_reference), np.nan)


def _details(told: ExchangeFit, light: str) -> dict[str, Any]:
    return {
        "irradiance": light,
        "steepness_w_m2_k": told.steepness_w_m2_k,
        "steepness_sd": told.steepness_sd,
        "alpha": told.alpha,
        "beta": told.beta,
        "alpha_and_beta_are_the_prior": told.share_is_prior,
    }
