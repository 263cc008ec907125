"""Sand and light meter as learnt from a session, as a record that becomes the next session's prior."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict

import numpy as np

from fieldkit.calibrate.inputs import end_of, record_source
from fieldkit.calibrate.result import Calibration, stamped
from fieldkit.calibration.calibration_record import CalibrationRecord
from fieldkit.calibration.uncertainty import Contribution, combined_uncertainty
from fieldkit.config import Config
from fieldkit.estimation.bins import History
from fieldkit.estimation.carried import Carried, carried, keys
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.prior_state import DAY_TO_DAY
from fieldkit.estimation.scale import with_known
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import CalibrationError
from fieldkit.model.learnt import Learnt
from fieldkit.model.region_schedule import Regions
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.sources import regions_for
from fieldkit.sessions.reader import SessionReader

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
    known = carried(settings, [(settings, learnt)])
    steeper_deg = tilt_sd_deg if any(region.name in beds for region in regions.columns) else 0.0
    steeper = _learnt(history, with_known(regions, beds, steeper_deg), settings) if steeper_deg else learnt
    budget = _budget(known["gain"], _gain(steeper) - _gain(learnt), tilt_sd_deg)
    gain_sd = combined_uncertainty(budget)
    known["gain"] = Carried(known["gain"].value, gain_sd / known["gain"].value)
    brought = keys(known, settings)
    record = CalibrationRecord(
        "surface",
        name,
        end_of(session),
        known["gain"].value,
        gain_sd,
        "1",
        "learned model",
        budget=budget,
        values={key: brought[place] for place, key in VALUES.items()},
        uncertainties=_uncertainties(brought, known),
        sources=(record_source(session.path),),
        details=_details(history, learnt, brought, settings),
        settings={"name": name, "beds": sorted(beds), "tilt_sd": tilt_sd_deg},
        remarks=(WEATHER,),
    )
    used_by = ", ".join(f'{key} = "@{name}"' for key in ("estimator.scale", *VALUES))
    return Calibration(stamped(record), _summary(known, gain_sd, len(history)), used_by, config.calibration)


def _learnt(history: History, regions: Regions, settings: EstimatorSettings) -> Learnt:
    found = SlopeChain(regions, settings).at(history)
    if found.learnt is None:
        reasons = sorted({slope.reason for slope in found.slopes if slope.reason})
        raise CalibrationError(f"nothing was learnt: {', '.join(reasons) or 'no target regions'}")
    return found.learnt


def _gain(learnt: Learnt) -> float:
    return next(one.value for one in learnt.parameters if one.name == "gain")


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


def _details(
    history: History, learnt: Learnt, brought: Mapping[str, float], settings: EstimatorSettings
) -> dict[str, object]:
    return {
        "model": settings.model,
        "minutes": int(np.isfinite(history.temperature_k).all(axis=1).sum()),
        "heat_capacity_j_m3_k": settings.slab.heat_capacity_j_m3_k,
        "prior_sds": {key: value for key, value in brought.items() if key.endswith(("_sd", "_share"))},
        "learnt": {one.name: asdict(one) for one in learnt.parameters},
    }


def _summary(known: Mapping[str, Carried], gain_sd: float, minutes: int) -> str:
    inertia, depth = known["thermal_inertia"], known["depth"]
    return (
        f"gain {known['gain'].value:.3f} ± {2.0 * gain_sd:.3f} (k=2)   learned model, {minutes} minutes\n"
        f"  thermal inertia {inertia.value:.0f} J m⁻² K⁻¹ s⁻½ ± {2.0 * inertia.log_sd:.0%}   "
        f"depth {depth.value:.1f} cm ± {2.0 * depth.log_sd:.0%}"
    )
