"""The scale kappa of the surface from target regions of known slope, and what they show of eq. (6).

With the learned model: everything that the session taught of its sand (`fieldkit.calibrate.surface`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from fieldkit.calibrate.inputs import open_to_calibrate
from fieldkit.calibrate.result import Calibration, make_record
from fieldkit.calibration.ranges import require_ranges
from fieldkit.calibration.surface_scale import BedScale, PooledScale, pool
from fieldkit.calibration.uncertainty import Contribution, combined_uncertainty
from fieldkit.config import Config
from fieldkit.estimation import balance
from fieldkit.estimation.balance import Rows
from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.carried import Carried, carry_over, keys
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.prior_state import DAY_TO_DAY
from fieldkit.estimation.normal import LOWEST_COS_INCIDENCE
from fieldkit.estimation.region_temperatures import remove_offsets
from fieldkit.estimation.scale import (
    ExchangeFit,
    KnownSlope,
    identify,
    known_slopes,
    scale_from_known_bed,
    with_known,
)
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import CalibrationError
from fieldkit.model.learnt import Learnt
from fieldkit.model.region_schedule import Regions
from fieldkit.model.samples import Quality
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.sources import (
    SessionOrFile,
    Settings,
    config_for,
    log_warning,
    regions_for,
    settings_from,
)
from fieldkit.sessions.reader import SessionReader

CLOUDY = Quality.CLOUD | Quality.LOW_SUN | Quality.MOVED


def surface(
    session: SessionOrFile,
    *,
    beds: Sequence[str] = (),
    tilt_sd_deg: float = 0.5,
    name: str = "beds",
    settings: Settings = (),
    notify: Callable[[str], None] = log_warning,
) -> Calibration:
    """Find the scale kappa of a session from its target regions of known tilt and azimuth.

    kappa belongs to one surface model and one irradiance source: change neither after calibrating. With the
    learned model, the session's gain, thermal inertia and depth are the next session's prior ("this sand");
    regions of known slope sharpen them and are not needed.

    Parameters
    ----------
    session : Session or path
        A recording with target regions whose ``tilt_deg`` and ``azimuth_deg`` are known.
    beds : sequence of str
        Only these regions; by default all of known slope.
    tilt_sd_deg : float
        Standard uncertainty of the inclinometer. [degrees]
    name : str
        Names the record.
    settings : mapping, or sequence of ``KEY=VALUE``
        Other values for keys of the configuration, such as ``surface.albedo=0.25``.
    notify : callable
        Receives warnings, such as damaged samples that were excluded.

    Raises
    ------
    ConfigError
        If a region of `beds` has no known slope.
    CalibrationError
        If no region has, if there are too few clear minutes, or if the regions disagree. With the learned
        model: if the session teaches nothing.

    Examples
    --------
    >>> fieldkit.calibrate.surface(session, settings={"estimator.model": "paper"})
    <Calibration: kappa 1.132 ± 0.031 (k=2)   paper model, eq10 /0.44, diffuse 15%, horizontal
      b05 1.079   b15 1.118   b25 1.138>
    """
    require_ranges({"tilt_sd_deg": tilt_sd_deg})
    with open_to_calibrate(session, settings, notify) as (opened, config):
        if config.tables.estimator.model == "learned":
            bed_slopes = known_slopes(regions_for(opened, config).latest, beds, opened.path)
            return sand(opened, config, bed_slopes, tilt_sd_deg, name)
        # kappa is measured relative to one, whatever was configured
        config = config_for(opened, (*settings_from(settings), "estimator.scale=1.0"))
        minutes = SessionMinutes(opened, config)
        history = minutes.history
        bed_slopes = known_slopes(minutes.regions, beds, opened.path)
        if not bed_slopes:
            raise CalibrationError(
                "no region of known slope",
                place=opened.path,
                fix="give tilt_deg and azimuth_deg of one bed of 10 to 25 degrees",
            )
        rows = clear_rows(minutes, history)
        scales = {bed: _scale_of(rows, slope, tilt_sd_deg) for bed, slope in bed_slopes.items()}
        pooled = pool(scales, tilt_sd_deg)
        model = fit_exchange(minutes, history, bed_slopes)
        record = make_record(
            "surface",
            name,
            pooled.kappa,
            "1",
            pooled.budget,
            [opened],
            method=f"beds of known slope, {minutes.settings.model} model",
            degrees_of_freedom=pooled.freedom,
            values={bed: scale.kappa for bed, scale in scales.items()},
            uncertainties={bed: scale.kappa_sd for bed, scale in scales.items()},
            details=_details(model, minutes),
            settings={"name": name, "beds": list(bed_slopes), "tilt_sd": tilt_sd_deg},
            remarks=(model.summary,),
        )
        summary = _summary(pooled, scales, minutes)
        return Calibration(record, summary, f'estimator.scale = "@{name}"', config.calibration)


def clear_rows(minutes: SessionMinutes, history: History) -> Rows:
    """Rows of the energy balance for all minutes of a session and all targets; NaN where it was not clear."""
    columns, settings = RegionColumns(minutes.regions), minutes.settings
    true = remove_offsets(history, columns.regions, settings)
    rows = balance.least_squares_rows(true, 0, columns, settings)
    is_clear = (history.flags & int(CLOUDY))[:, np.newaxis] == 0
    return replace(rows, y=np.where(is_clear, rows.y, np.nan))


def _scale_of(rows: Rows, slope: KnownSlope, tilt_sd_deg: float) -> BedScale:
    """The scale of one region, and its change with the inclinometer's error."""
    y, sigma = rows.y[:, slope.column], rows.sigma[:, slope.column]
    is_lit = np.isfinite(rows.design).all(axis=1) & np.isfinite(sigma)
    is_lit &= np.minimum(rows.sun @ slope.normal(), rows.sun @ rows.reference) >= LOWEST_COS_INCIDENCE
    data = rows.design[is_lit], y[is_lit], sigma[is_lit], rows.reference
    bed_scale = scale_from_known_bed(*data, slope.normal())
    steeper = scale_from_known_bed(*data, slope.normal(steeper_deg=tilt_sd_deg))
    return BedScale(bed_scale.kappa, bed_scale.kappa_sd, steeper.kappa - bed_scale.kappa)


def fit_exchange(minutes: SessionMinutes, history: History, known: Mapping[str, KnownSlope]) -> ExchangeFit:
    """Evidence of the regions of known slope on alpha and beta of eq. (6)."""
    columns, surface = RegionColumns(minutes.regions), minutes.settings.surface
    names = [region.name for region in minutes.regions]
    warm = np.concatenate([history.temperature_k[:, names.index(name)] for name in known])
    reference_normal = columns.reference_normals.mean(axis=0)
    excess = np.concatenate(
        [_excess_dni(history, slope.normal(), reference_normal) for slope in known.values()]
    )
    cold = np.tile(_reference_k(history, columns), len(known))
    is_known = np.isfinite(warm) & np.isfinite(excess) & np.isfinite(cold)
    if is_known.sum() < len(known) * 3:
        raise CalibrationError("too few minutes with light and temperatures", fix="take a longer session")
    data, prior = (warm[is_known], cold[is_known], excess[is_known]), (surface.alpha, surface.beta)
    first = identify(*data, minutes.settings.noise_k, prior)
    # what the surface does beside eq. (6) counts as noise too, or the split would look measured
    residual_k = data[0] - data[1] - data[2] / first.steepness_w_m2_k
    noise_k = max(minutes.settings.noise_k, float(np.std(residual_k)) / np.sqrt(2.0))
    return identify(*data, noise_k, prior)


def _reference_k(history: History, columns: RegionColumns) -> FloatArray:
    """Mean temperature (n,) of the reference regions that have one; NaN where none has."""
    base = history.temperature_k[:, columns.references]
    is_known = np.isfinite(base)
    mean = np.where(is_known, base, 0.0).sum(axis=1) / is_known.sum(axis=1).clip(1)
    return np.where(is_known.any(axis=1), mean, np.nan)


def _excess_dni(history: History, target: FloatArray, reference: FloatArray) -> FloatArray:
    """Direct irradiance (n,) of a target beyond the reference's, W/m2; NaN while one is in its own shade."""
    on_target, on_reference = history.sun @ target, history.sun @ reference
    is_lit = np.minimum(on_target, on_reference) >= LOWEST_COS_INCIDENCE
    return np.where(is_lit, history.dni_w_m2 * (on_target - on_reference), np.nan)


def _details(model: ExchangeFit, minutes: SessionMinutes) -> dict[str, Any]:
    return {
        "model": minutes.settings.model,
        "irradiance": minutes.measured.irradiance_model,
        "steepness_w_m2_k": model.steepness_w_m2_k,
        "steepness_sd": model.steepness_sd,
        "alpha": model.alpha,
        "beta": model.beta,
        "alpha_and_beta_are_the_prior": model.share_is_prior,
    }


def _summary(found: PooledScale, scales: Mapping[str, BedScale], minutes: SessionMinutes) -> str:
    each = "   ".join(f"{bed} {scale.kappa:.3f}" for bed, scale in scales.items())
    return (
        f"kappa {found.kappa:.3f} ± {found.expanded:.3f} (k=2)   {minutes.settings.model} model, "
        f"{minutes.measured.irradiance_model}\n  {each}"
    )


# --- this sand: everything that the learned model learnt of it


WEATHER = "exchange, gusts, sky and air belong to that day's weather and are not carried over"
VALUES = {"slab.conductivity_w_m_k": "conductivity_w_m_k", "slab.depth_m": "depth_m"}
"""Keys that take a value of the record besides its gain, and its name there."""


def sand(
    session: SessionReader, config: Config, beds: Collection[str], tilt_sd_deg: float, name: str
) -> Calibration:
    """Learn gain, thermal inertia and depth from an open session in which the slopes of `beds` are known.

    Raises `CalibrationError` if the session teaches nothing.
    """
    regions, settings = regions_for(session, config), config.estimator_settings()
    history = SessionMinutes(session, config).measured.history
    learnt = _learnt(history, with_known(regions, beds), settings)
    prior = carry_over(settings, [(settings, learnt)])
    steeper_deg = tilt_sd_deg if any(region.name in beds for region in regions.columns) else 0.0
    steeper = _learnt(history, with_known(regions, beds, steeper_deg), settings) if steeper_deg else learnt
    budget = _budget(prior["gain"], _gain(steeper) - _gain(learnt), tilt_sd_deg)
    gain_sd = combined_uncertainty(budget)
    prior["gain"] = Carried(prior["gain"].value, gain_sd / prior["gain"].value)
    brought = keys(prior, settings)
    record = make_record(
        "surface",
        name,
        prior["gain"].value,
        "1",
        budget,
        [session],
        method="learned model",
        values={key: brought[place] for place, key in VALUES.items()},
        uncertainties=_uncertainties(brought, prior),
        details=_sand_details(history, learnt, brought, settings),
        settings={"name": name, "beds": sorted(beds), "tilt_sd": tilt_sd_deg},
        remarks=(WEATHER,),
    )
    used_by = ", ".join(f'{key} = "@{name}"' for key in ("estimator.scale", *VALUES))
    return Calibration(record, _sand_summary(prior, gain_sd, len(history)), used_by, config.calibration)


def _learnt(history: History, regions: Regions, settings: EstimatorSettings) -> Learnt:
    estimated = SlopeChain(regions, settings).at(history)
    if estimated.learnt is None:
        reasons = sorted({slope.reason for slope in estimated.slopes if slope.reason})
        raise CalibrationError(f"nothing was learnt: {', '.join(reasons) or 'no target regions'}")
    return estimated.learnt


def _gain(learnt: Learnt) -> float:
    return next(parameter.value for parameter in learnt.parameters if parameter.name == "gain")


def _budget(gain: Carried, steeper: float, tilt_sd_deg: float) -> tuple[Contribution, ...]:
    daily = gain.value * DAY_TO_DAY["gain"]
    data = math.sqrt((gain.value * gain.log_sd) ** 2 - daily**2)
    return (
        Contribution("data and prior", data, "1", "A", data),
        Contribution("from day to day", daily, "1", "B", daily),
        *([Contribution("inclinometer", tilt_sd_deg, "deg", "B", steeper)] if steeper else []),
    )


def _uncertainties(brought: Mapping[str, float], known: Mapping[str, Carried]) -> dict[str, float]:
    """Standard uncertainties of `VALUES`; the conductivity goes with the square of the inertia."""
    relative = {
        "slab.conductivity_w_m_k": 2.0 * known["thermal_inertia"].log_sd,
        "slab.depth_m": known["depth"].log_sd,
    }
    return {key: brought[place] * relative[place] for place, key in VALUES.items()}


def _sand_details(
    history: History, learnt: Learnt, brought: Mapping[str, float], settings: EstimatorSettings
) -> dict[str, object]:
    return {
        "model": settings.model,
        "minutes": int(np.isfinite(history.temperature_k).all(axis=1).sum()),
        "heat_capacity_j_m3_k": settings.slab.heat_capacity_j_m3_k,
        "prior_sds": {key: value for key, value in brought.items() if key.endswith(("_sd", "_share"))},
        "learnt": {parameter.name: asdict(parameter) for parameter in learnt.parameters},
    }


def _sand_summary(known: Mapping[str, Carried], gain_sd: float, minutes: int) -> str:
    inertia, depth = known["thermal_inertia"], known["depth"]
    return (
        f"gain {known['gain'].value:.3f} ± {2.0 * gain_sd:.3f} (k=2)   learned model, {minutes} minutes\n"
        f"  thermal inertia {inertia.value:.0f} J m⁻² K⁻¹ s⁻½ ± {2.0 * inertia.log_sd:.0%}   "
        f"depth {depth.value:.1f} cm ± {2.0 * depth.log_sd:.0%}"
    )
