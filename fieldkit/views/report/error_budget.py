"""The error budget: how many degrees of tilt each cause may cost, from the session's own numbers.

The paper's eq. (6) contains direct irradiance and the exchange with air and sky that all targets share.
What it omits is computed here term by term with the functions of the full model, and
each term is converted to degrees of tilt by the change of direct irradiance with tilt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import get_args

import numpy as np

from fieldkit.estimation.budget import BudgetTerm
from fieldkit.estimation.estimator_keys import Model
from fieldkit.estimation.region_temperatures import difference_k
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics import daylight
from fieldkit.physics.bodies import BODIES
from fieldkit.physics.energy_balance import emitted_longwave
from fieldkit.physics.facet import cos_incidence, normal
from fieldkit.physics.slab import conducted_flux
from fieldkit.views import formatting, learnt_words
from fieldkit.views.html import Table, strong
from fieldkit.views.report.series import ReportData, Series, TargetSeries

OFFSET_K = 0.3
SCALE = 0.10
READING = (
    "to first order, azimuth known; in brackets the cause as a term of eq. (6). "
    "Plus: the region seems turned more towards the sun."
)
"""Caption of the table."""
LEAST_SHARE = 1e-3
GUM = (
    "Share of each input in the variance of the tilt (JCGM 100:2008). Type A: known from this session's "
    "minutes; B: from the prior. Uncertainties without a unit are relative. A negative share offsets others."
)
MODELS = "The same minutes by each model: tilts at the last minute with a slope. Bold: used above."
"""Caption of the table of models."""
MODEL_WORDS: Mapping[Model, str] = {
    "paper": "The slopes above were estimated without them.",
    "full": "The slopes above are by the full model, which includes them as configured.",
    "learned": "The slopes above are by the learned model, which includes them and learns their size.",
}


def error_budget(data: ReportData) -> Mapping[str, object] | None:
    """The section of a session: what the models omit, how they compare, causes, and advice.

    None without targets or without irradiance.
    """
    if not data.columns.targets or not np.isfinite(data.columns.irradiance_w_m2).any():
        return None
    budgets = [budget(data.columns, target, data.settings) for target in data.columns.targets]
    columns = ("cause", *(budget.name for budget in budgets))
    caption = f"Degrees of tilt, medians over the session, {READING}"
    return {
        "summary": _omitted_words(data, budgets),
        "meaning": GUM if data.budgets else "",
        "slopes": [_slope_table(name, terms) for name, terms in data.budgets.items()],
        "models": model_table(data) if data.by_others else None,
        "contributions": Table(columns, cause_rows(budgets), caption),
        "advice": _advice(budgets),
    }


def _slope_table(region: str, terms: Sequence[BudgetTerm]) -> Table:
    """The budget of one slope; terms below a thousandth of the variance are left to the table in CSV."""
    rows = [
        (
            learnt_words.NAMES.get(term.name, term.name.replace("_", " ")),
            term.kind,
            f"{term.uncertainty:.2g} {term.unit}".strip(),
            f"{term.sensitivity:+.2g}°",
            f"{term.share:.1%}",
        )
        for term in terms
        if abs(term.share) >= LEAST_SHARE
    ]
    columns = ("term", "type", "standard uncertainty", "° per unit", "of the variance")
    return Table(columns, rows, f"Tilt of {region}.")


def model_table(data: ReportData) -> Table:
    """The final slope of each target by each model."""
    used, names = data.settings.model, [target.region.name for target in data.columns.targets]
    finals = [target.final_estimate for target in data.columns.targets]
    by_model = {**data.by_others, used: [final for final in finals if final is not None]}
    rows = []
    for model in (model for model in get_args(Model) if model in by_model):
        tilts = {slope.region: formatting.tilt(slope) for slope in by_model[model]}
        cells = (tilts.get(name, formatting.UNKNOWN) for name in names)
        rows.append([strong(model) if model == used else model, *cells])
    return Table(("model", *names), rows, MODELS)


def cause_rows(budgets: Sequence[ErrorBudget]) -> list[list[object]]:
    """Rows of the table: a cause, and what it costs each target."""
    causes: dict[str, Callable[[ErrorBudget], str]] = {
        "omitted: diffuse light": lambda b: _degrees(b, b.diffuse_w_m2),
        "omitted: light reflected by the ground": lambda b: _degrees(b, b.reflected_w_m2),
        "omitted: longwave of sky and ground": lambda b: _degrees(b, b.longwave_w_m2),
        "omitted: heat stored in the sand": lambda b: _degrees(b, b.storage_w_m2),
        "all omitted terms": lambda b: _degrees(b, b.omitted_w_m2),
        "half the width of the likelihood region": lambda b: _either_way(b.noise_deg),
        f"{OFFSET_K:g} K between region and reference": lambda b: _either_way(b.of_offset(OFFSET_K)),
        f"irradiance wrong by {SCALE:.0%}": lambda b: _either_way(b.of_scale(SCALE)),
    }
    rows: list[list[object]] = [[name, *map(of, budgets)] for name, of in causes.items()]
    return [*rows, *_calibration_rows(budgets)]


def _calibration_rows(budgets: Sequence[ErrorBudget]) -> Iterator[list[object]]:
    """Rows of the calibrations' uncertainties, one standard uncertainty each."""
    contributions: dict[str, Callable[[ErrorBudget], tuple[float, str]]] = {
        "emissivity as calibrated": lambda b: (b.of_offset(b.emissivity_k), f"{b.emissivity_k:.2f} K"),
        "light meter as calibrated": lambda b: (b.of_scale(b.factor_sd), f"{b.factor_sd:.1%}"),
    }
    for name, of in contributions.items():
        cells = [of(budget) for budget in budgets]
        if any(degrees for degrees, _ in cells):
            yield [name, *(f"{_either_way(degrees)} ({amount})" for degrees, amount in cells)]


def _either_way(degrees: float) -> str:
    return f"{formatting.number(abs(degrees), 1)}°"


def _degrees(budget: ErrorBudget, term_w_m2: float) -> str:
    degrees = budget.degrees(term_w_m2)
    if not np.isfinite(degrees):
        return formatting.UNKNOWN
    return f"{degrees:+.1f}° ({term_w_m2:+.0f} W/m²)"


def _omitted_words(data: ReportData, budgets: Sequence[ErrorBudget]) -> str:
    settings, slab = data.settings, data.settings.slab
    costs = [abs(budget.degrees(budget.omitted_w_m2)) for budget in budgets]
    finite = [cost for cost in costs if np.isfinite(cost)]
    cost = formatting.number(float(np.mean(finite)) if finite else float("nan"), 1)
    omitted = (
        "The paper's model, eq. (6), has direct sunlight and a heat exchange that region and reference "
        "share. It omits diffuse light, sky longwave and stored heat, which differ on a slope. With "
        f"{settings.diffuse_fraction:.0%} diffuse light, {settings.longwave_down_w_m2:.0f} W/m² of sky "
        f"longwave and {slab.depth_m * 100:g} cm of sand they bias the tilt by {cost}° here, on average over "
        "the regions; they partly cancel."
    )
    return f"{omitted} {MODEL_WORDS[settings.model]}"


def _advice(budgets: Sequence[ErrorBudget]) -> list[str]:
    weakest = min(budgets, key=lambda budget: np.nan_to_num(abs(budget.kelvin_per_degree), nan=np.inf))
    offset_deg = formatting.number(abs(weakest.of_offset(OFFSET_K)), 1)
    return [
        f"Offsets between regions do not average out: at {formatting.number(weakest.kelvin_per_degree, 2)} K "
        f"per degree, {OFFSET_K:g} K cost {weakest.name} {offset_deg}°. Measure them on a uniform target "
        "before and after the session (fieldkit calibrate uniformity).",
        "A longer window averages out noise, but no other uncertainty. The azimuth needs an hour or more of "
        "sun motion.",
        "A wrong irradiance scale (light meter, model, albedo, heat exchange) scales all tilts alike; a "
        "region of known slope calibrates it.",
    ]


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """Medians over the session for one target.

    The four terms are what the paper's model attributes to direct irradiance although it is not, in W/m2 of
    eq. (6); with positive terms the target seems to face the sun more than it does.
    `w_m2_per_degree` is the change of direct irradiance on the target with its tilt; `noise_deg` half
    the width of the likelihood region. `emissivity_k` is the standard uncertainty of target minus reference
    by calibrated emissivities, `factor_sd` the relative one of a calibrated light meter.
    """

    name: str
    diffuse_w_m2: float
    reflected_w_m2: float
    longwave_w_m2: float
    storage_w_m2: float
    w_m2_per_degree: float
    kelvin_per_degree: float
    noise_deg: float
    tilt_deg: float
    emissivity_k: float = 0.0
    factor_sd: float = 0.0

    @property
    def omitted_w_m2(self) -> float:
        """Sum of the four terms; they partly cancel."""
        return self.diffuse_w_m2 + self.reflected_w_m2 + self.longwave_w_m2 + self.storage_w_m2

    def degrees(self, term_w_m2: float) -> float:
        """Bias of the tilt by a term, in degrees, to first order."""
        return term_w_m2 / self.w_m2_per_degree

    def of_offset(self, offset_k: float) -> float:
        """Bias of the tilt by a constant temperature offset between target and reference, in degrees."""
        return offset_k / self.kelvin_per_degree

    def of_scale(self, relative: float) -> float:
        """Bias of the tilt by a relative error of the irradiance, in degrees, to first order."""
        return relative * self.tilt_deg


def budget(columns: Series, target: TargetSeries, settings: EstimatorSettings) -> ErrorBudget:
    """Error budget of one target at its given slope, or at its estimated slope if none was given.

    Medians over the session; the omitted terms follow from the settings' full-model parameters.
    """
    tilt, azimuth = _slope(target)
    cos_tilt = float(np.cos(np.radians(tilt)))
    in_sun = columns.irradiance_w_m2 > 0
    light = np.where(in_sun, columns.irradiance_w_m2, np.nan)
    assumed = settings.diffuse_fraction / (1 - settings.diffuse_fraction) * light * columns.cos_zenith
    diffuse = np.where(np.isnan(columns.diffuse_w_m2), assumed, columns.diffuse_w_m2)
    above_air = daylight.extraterrestrial(columns.time_ns, BODIES[settings.body])
    incidence = cos_incidence(normal(tilt, azimuth), columns.sun)
    on_target = daylight.hay_davies_diffuse(
        diffuse, light, above_air, incidence, columns.cos_zenith, cos_tilt
    )
    global_light = diffuse + light * columns.cos_zenith
    reflected = daylight.ground_reflected(global_light, settings.ground_albedo, cos_tilt)
    absorbing = 1.0 - settings.surface.albedo
    return ErrorBudget(
        name=target.region.name,
        diffuse_w_m2=_median(on_target - diffuse),
        reflected_w_m2=_median(reflected),
        longwave_w_m2=_median(_longwave(columns, cos_tilt, settings)) / absorbing,
        storage_w_m2=_median(-_stored_heat(columns, target, settings)) / absorbing,
        w_m2_per_degree=_median(light * _per_degree(columns, tilt, azimuth)),
        kelvin_per_degree=_median(target.values("kelvin_per_degree")),
        noise_deg=_median(target.values("tilt_half_width_deg", solved=True)),
        tilt_deg=tilt,
        emissivity_k=_median(_of_emissivity(columns, target, settings)),
        factor_sd=settings.factor_sd,
    )


def pool(name: str, budgets: Sequence[ErrorBudget]) -> ErrorBudget:
    """The medians over several sessions, under one name."""
    numbers = [field.name for field in fields(ErrorBudget) if field.name != "name"]
    columns = {number: np.array([getattr(budget, number) for budget in budgets]) for number in numbers}
    return ErrorBudget(name, **{number: _median(values) for number, values in columns.items()})


def _slope(target: TargetSeries) -> tuple[float, float]:
    truth = (target.region.tilt_deg, target.region.azimuth_deg)
    estimated = (_median(target.estimated_tilt_deg), _median(target.values("azimuth_deg")))
    return truth if np.isfinite(truth).all() else estimated


def _per_degree(columns: Series, tilt_deg: float, azimuth_deg: float) -> FloatArray:
    """Change of cos(incidence) per degree of tilt, per minute."""
    tilt, azimuth = np.radians([tilt_deg, azimuth_deg])
    towards = np.array([np.cos(tilt) * np.sin(azimuth), np.cos(tilt) * np.cos(azimuth), -np.sin(tilt)])
    return np.asarray(np.radians(columns.sun @ towards))


def _longwave(columns: Series, cos_tilt: float, settings: EstimatorSettings) -> FloatArray:
    """Absorbed longwave that the target receives from the surrounding ground instead of the sky, W/m2."""
    measured_w_m2, emissivity = columns.longwave_w_m2, settings.surface.emissivity_broadband
    down = np.where(np.isnan(measured_w_m2), settings.longwave_down_w_m2, measured_w_m2)
    ground = emitted_longwave(columns.reference_k, emissivity) + (1.0 - emissivity) * down
    return emissivity * (daylight.longwave_on_facet(down, ground, cos_tilt) - down)


def _of_emissivity(columns: Series, target: TargetSeries, settings: EstimatorSettings) -> FloatArray:
    """Standard uncertainty of target minus reference by their emissivities, kelvin."""
    if not columns.references:
        return np.zeros(columns.time_ns.size)
    temperatures = columns.temperature_k[target.region.name], columns.reference_k
    return difference_k(*temperatures, target.region, columns.references[0], settings)


def _stored_heat(columns: Series, target: TargetSeries, settings: EstimatorSettings) -> FloatArray:
    """Storage heat flux of the target minus that of the reference, W/m2."""
    difference = columns.temperature_k[target.region.name] - columns.reference_k
    has_value = np.isfinite(difference)
    flux = np.full(difference.shape, np.nan)
    if has_value.sum() > 1:
        minutes = columns.time_ns[has_value] // MINUTE_NS
        every = np.arange(minutes[0], minutes[-1] + 1)
        bridged = np.interp(every, minutes, difference[has_value])
        flux[has_value] = conducted_flux(settings.slab, bridged, MINUTE_NS / 1e9)[minutes - minutes[0]]
    return flux


def _median(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")
