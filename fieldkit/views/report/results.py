"""The results of a report: slopes of the targets, figures over time, and the paper's Figs. 12 and 13."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from fieldkit.estimation.balance import GROUND_ALBEDO_SD
from fieldkit.estimation.settings import PAPER_SCALE_SD, EstimatorSettings
from fieldkit.estimation.statistics import ErrorSpan, SdKind, errors_over_time
from fieldkit.model.arrays import FloatArray
from fieldkit.model.channels import is_air_temperature
from fieldkit.model.confidence import percent
from fieldkit.model.slope import SlopeEstimate
from fieldkit.views import formatting, study_figures
from fieldkit.views.html import Figure, Table, strong
from fieldkit.views.report import session_figures
from fieldkit.views.report.series import (
    ReportData,
    Series,
    TargetSeries,
    figure_over_time,
    modelled_temperature,
    temperature_rmse_k,
)

SPAN_S = 1200.0
"""Length of the means in Fig. 13."""


def slopes(data: ReportData) -> Table:
    """Each target with its final slope and the slope that was given."""
    caption = f"{formatting.region_words(percent(data.settings.confidence))}."
    checks = map(formatting.reference_check, data.checks)
    caption = " ".join([caption, *(f"{words[0].upper()}{words[1:]}." for words in checks)])
    columns = ("region", "tilt °", "azimuth °", "given", "state")
    return Table(columns, list(map(_slope_row, data.columns.targets)), caption)


def accuracy(data: ReportData) -> Table:
    """Each target with the parts of its uncertainty, and its error against the given slope."""
    columns = {
        "region": "",
        "noise": "Noise: the ± of the tilt by noise alone.",
        "also fits": "Also fits: another slope (tilt/azimuth) that explains the same minutes.",
        "K per °": "K per °: change of the temperature difference with tilt.",
        "last error °": "Last error: final tilt less given tilt.",
        "mean |error| (SD) °": "Mean |error|: mean absolute difference from the given tilt over the n "
        f"minutes with an estimate, without slopes held through clouds. SD {sd_words(data.sd)}.",
        "n": "",
    }
    rows = [_accuracy_row(target, data.sd) for target in data.columns.targets]
    sure = percent(data.settings.confidence)
    has_values = [any(row[index] != formatting.UNKNOWN for row in rows) for index in range(len(columns))]
    caption = (
        f"The {sure} region {likelihood_words(data.settings)}. "
        f"Wide: {formatting.wide_means(sure, data.settings.target_half_width_deg)}. "
        f"{' '.join(filter(None, itertools.compress(columns.values(), has_values)))}"
    )
    visible_rows = [list(itertools.compress(row, has_values)) for row in rows]
    return Table(list(itertools.compress(columns, has_values)), visible_rows, caption)


def caveat(settings: EstimatorSettings) -> str:
    """Omissions of the paper's model, as one sentence; empty with other settings."""
    if (settings.model, settings.azimuth) != ("paper", "free"):
        return ""
    return f"{formatting.PAPER_OMITS[0].upper()}{formatting.PAPER_OMITS[1:]}."


def likelihood_words(settings: EstimatorSettings) -> str:
    """Uncertainties that the likelihood region covers."""
    parts = [f"noise of {settings.noise_k:g} K"]
    if settings.offset_sd_k > 0:
        parts.append(f"an offset between regions of {settings.offset_sd_k:g} K")
    emissivity_sds = {settings.emissivity_sd, *settings.own_emissivity_sd.values()} - {0.0}
    parts += [f"an emissivity good to {sd:.3f}" for sd in sorted(emissivity_sds)]
    if settings.model == "learned":
        parts.append(f"a drift between them of {settings.drift_sd_k_per_h:g} K/h")
        return f"covers {', '.join(parts)}, and the remaining uncertainty of every learnt parameter"
    relative_sds = {
        "an irradiance scale": settings.scale_sd,
        "a light meter's factor": settings.factor_sd,
        "an exchange with the air": settings.exchange_sd,
    }
    if settings.model == "full":
        relative_sds |= {
            "a conductivity of the sand": settings.conductivity_sd,
            "its heat capacity": settings.capacity_sd,
        }
        parts.append(
            f"a ground's albedo good to {GROUND_ALBEDO_SD:.2f}, the shape of the sky, its diffuse light"
        )
    parts += [f"{name} good to {sd:.0%}" for name, sd in relative_sds.items() if sd > 0]
    if settings.model == "paper":
        parts.append(f"and {PAPER_SCALE_SD:.0%} of scale for what the paper's model omits")
    return "covers " + ", ".join(parts)


def sd_words(sd: SdKind) -> str:
    """Kind of the standard deviation shown."""
    if sd == "paper":
        return "by eq. (9) as printed, with n outside the root: the standard error of the mean"
    return "the ordinary standard deviation of the absolute error"


def _slope_row(target: TargetSeries) -> list[object]:
    final = target.final_estimate
    return [
        strong(target.region.name),
        target.final_words,
        formatting.azimuth(final) if final else formatting.UNKNOWN,
        formatting.given_slope(target.region),
        _state(final, target.last),
    ]


def _accuracy_row(target: TargetSeries, sd: SdKind) -> list[object]:
    final = target.final_estimate
    error = final.tilt_deg - target.region.tilt_deg if final else float("nan")
    return [
        strong(target.region.name),
        formatting.noise(final) if final else formatting.UNKNOWN,
        (final and formatting.second_branch(final)) or formatting.UNKNOWN,
        formatting.slope_number(final, "kelvin_per_degree") if final else formatting.UNKNOWN,
        f"{error:+.1f}" if np.isfinite(error) else formatting.UNKNOWN,
        target.error_words(sd),
        int(np.isfinite(target.estimated_tilt_deg).sum()),
    ]


def _state(final: SlopeEstimate | None, last: SlopeEstimate | None) -> str:
    """The state of the slope that is shown, and of the last minute if it differs."""
    if last is None:
        return "no estimate"
    ended = formatting.state(last, second=False)
    final_state = formatting.state(final, second=False) if final else ended
    return final_state if final_state == ended else f"{final_state}; at the end: {ended}"


# ---------------------------------------------------------------------- over time


def slope_figures(data: ReportData) -> Iterator[Figure]:
    """The tilts of the targets over the session; nothing where no slope was found."""
    columns, sure = data.columns, percent(data.settings.confidence)
    if _has_slopes(columns):
        yield figure_over_time(
            data,
            session_figures.tilts(columns, data.site),
            f"Tilt of each region. Shaded: {sure} likelihood region; dashed: given tilt; crosses: unreliable "
            f"(held, shaded, no intersection); ticks at the bottom: no slope.{_clouds(columns)}",
            f"Tilt against local time. {_final_tilts(columns)}",
            lambda minute: _tilts_at(columns, minute),
        )


def _tilts_at(columns: Series, minute: int) -> Iterator[str]:
    for target in columns.targets:
        if estimate := target.estimates[minute]:
            yield f"{target.region.name} {formatting.tilt_degrees(estimate)}, {formatting.state(estimate)}"


def time_figures(data: ReportData) -> Iterator[Figure]:
    """Azimuths, temperatures and irradiance over the session, as far as they were recorded."""
    columns, site = data.columns, data.site
    clouds = _clouds(columns)
    if data.settings.azimuth == "free" and _has_slopes(columns):
        yield figure_over_time(
            data,
            session_figures.azimuths(columns, site),
            "Azimuth of each region's normal with its likelihood region; where it spans 360°, the data leave "
            "it open. Dashed: given azimuth.",
            "Azimuth of each region against local time.",
            lambda minute: _azimuths_at(columns, minute),
        )
    if any(np.isfinite(values).any() for values in (*columns.temperature_k.values(), columns.contact_k)):
        temperatures_k = _measured_k(data)
        yield figure_over_time(
            data,
            session_figures.temperatures(columns, data.channels, site),
            f"Surface temperature: {_temperature_words(columns)}.{clouds}",
            f"Surface temperatures against local time of {', '.join(temperatures_k)}.",
            lambda minute: _temperatures_at(temperatures_k, minute),
            parts=[region.name for region in columns.regions],
        )
    if np.isfinite(columns.illuminance_lx).any() or np.isfinite(columns.irradiance_w_m2).any():
        yield figure_over_time(
            data,
            session_figures.irradiance(columns, site),
            "Measured illuminance, and direct normal irradiance derived by the model "
            f"“{columns.irradiance_model}”.{clouds}",
            "Illuminance and derived direct normal irradiance against local time.",
            lambda minute: _irradiance_at(columns, minute),
        )


def _azimuths_at(columns: Series, minute: int) -> Iterator[str]:
    for target in columns.targets:
        if estimate := target.estimates[minute]:
            yield f"{target.region.name} {formatting.azimuth(estimate)}°"


def _measured_k(data: ReportData) -> Mapping[str, FloatArray]:
    """Surface temperatures that were measured, by region and probe, kelvin."""
    columns = data.columns
    channels = zip(data.channels, columns.contact_k.T, strict=False)
    probes = {f"probe {name}": kelvin for name, kelvin in channels if not is_air_temperature(name)}
    series = {**columns.temperature_k, **probes}
    return {name: kelvin for name, kelvin in series.items() if np.isfinite(kelvin).any()}


def _temperature_words(columns: Series) -> str:
    return "regions by the camera (lines), contact probes (marks)" if columns.regions else "contact probes"


def _temperatures_at(measured_k: Mapping[str, FloatArray], minute: int) -> Iterator[str]:
    for name, kelvin in measured_k.items():
        yield f"{name} {formatting.celsius(kelvin[minute], 1)} °C"


def _irradiance_at(columns: Series, minute: int) -> Iterable[str]:
    return (
        f"measured {formatting.number(columns.illuminance_lx[minute] / 1000.0, 1)} klx",
        f"derived DNI {formatting.number(columns.irradiance_w_m2[minute])} W/m²",
    )


def _has_slopes(columns: Series) -> bool:
    return any(np.isfinite(target.tilt_deg).any() for target in columns.targets)


def _clouds(columns: Series) -> str:
    return " Grey: cloud or changing light." if columns.cloudy.any() else ""


def _final_tilts(columns: Series) -> str:
    ends = [(target.region.name, target.final_estimate) for target in columns.targets]
    return " ".join(f"{name} ends at {formatting.tilt_degrees(final)}." for name, final in ends if final)


# ---------------------------------------------------------------------- as in the paper


def paper_comparison(data: ReportData) -> Mapping[str, object] | None:
    """The paper's evaluation applied to this session, its Figs. 12 and 13.

    None if no target's slope was given.
    """
    columns = data.columns
    by_model = {
        target.region.name: modelled_temperature(columns, target, data.settings.surface)
        for target in columns.targets
    }
    modelled = {name: kelvin for name, kelvin in by_model.items() if np.isfinite(kelvin).any()}
    if not modelled and not any(np.isfinite(target.region.tilt_deg) for target in columns.targets):
        return None
    rmse_k = temperature_rmse_k(columns.temperature_k, modelled)
    summary = (
        f"Measured against modelled surface temperature: RMSE {formatting.number(rmse_k, 2)} K over "
        f"{len(modelled)} regions (the paper: 1.83 K)."
    )
    return {"summary": summary, "figures": data.draw(lambda data: _comparison_figures(data, modelled))}


def _comparison_figures(data: ReportData, modelled_k: Mapping[str, FloatArray]) -> Iterator[Figure]:
    measured_k = {name: data.columns.temperature_k[name] for name in modelled_k}
    times_ns, errors = data.columns.of_day_ns(data.site), {}
    for target in data.columns.targets:
        if np.isfinite(truth_deg := target.region.tilt_deg):
            tilts_deg = target.estimated_tilt_deg
            spans = errors_over_time(times_ns, tilts_deg, truth_deg, span_s=SPAN_S, kind=data.sd)
            errors[target.region.name] = spans
    return paper_figures(measured_k, modelled_k, errors, data.zone, data.sd)


def paper_figures(
    measured_k: Mapping[str, FloatArray],
    modelled_k: Mapping[str, FloatArray],
    errors: Mapping[str, Sequence[ErrorSpan]],
    zone: str,
    sd: SdKind,
) -> Iterator[Figure]:
    """The paper's Figs. 12 and 13, as far as there are temperatures and errors, a colour for each name."""
    if modelled_k:
        rmse_k = temperature_rmse_k(measured_k, modelled_k)
        yield Figure(
            study_figures.measured_against_modelled(measured_k, modelled_k, rmse_k),
            "As Fig. 12 of the paper (RMSE 1.83 K): measured surface temperature against eq. (7) with the "
            "session's parameters. The reference stands in for air temperature and longwave, so it is not "
            "plotted.",
            f"Measured against modelled surface temperature, RMSE {rmse_k:.2f} kelvin.",
            parts=list(modelled_k),
        )
    if any(errors.values()):
        yield Figure(
            study_figures.errors_over_local_time(errors, zone),
            f"As Fig. 13 of the paper: absolute tilt error over local time, {SPAN_S / 60:.0f} min means. "
            f"Bars: one SD, {sd_words(sd)}.",
            f"Absolute tilt error against local time of {', '.join(errors)}.",
            parts=list(errors),
        )
