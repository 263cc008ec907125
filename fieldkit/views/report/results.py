"""Sections with the results: the beds, their slopes over time, the paper's Figs. 12 and 13."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from fieldkit.estimation.settings import PAPER_SCALE_SD
from fieldkit.estimation.statistics import (
    SdKind,
    errors_over_time,
    mean_absolute_error,
    root_mean_square_error,
    sd_of_absolute_error,
)
from fieldkit.model.slope import SlopeEstimate
from fieldkit.views import formatting, paper_figures
from fieldkit.views.html import Html, element, figure, paragraph, section, table
from fieldkit.views.report import session_figures
from fieldkit.views.report.report_data import LAB_HINT, Material
from fieldkit.views.report.series import Bed, FloatArray, Series, modelled_temperature

SPAN_S = 1200.0


def beds(material: Material) -> Html:
    """The final table: what each bed is, what was found, how far off it was."""
    rows = [_bed_row(bed, material) for bed in material.columns.beds]
    columns = (
        "bed",
        "given",
        "tilt °",
        "noise",
        "azimuth °",
        "also fits",
        "K per °",
        "error °",
        "MAE ± SD °",
        "n",
        "state",
    )
    caption = (
        "Tilt and azimuth are the last ones worked out, ± the larger half of their 90 % likelihood "
        f"region ({likelihood_words(material)}); noise is the same by noise alone. Uncertain: "
        f"{formatting.UNCERTAIN_MEANS}. Error is against "
        "the given tilt. MAE and SD are over the n minutes with an answer; slopes held over a cloud count "
        f"for nothing. SD {sd_words(material.sd)}."
    )
    doubt = paragraph(f"{formatting.PAPER_LEAVES_OUT[0].upper()}{formatting.PAPER_LEAVES_OUT[1:]}.")
    paper = [doubt] if (material.settings.model, material.settings.azimuth) == ("paper", "free") else []
    return section("Result", table(columns, rows, caption=caption), *paper)


def likelihood_words(material: Material) -> str:
    """What the likelihood region covers."""
    settings = material.settings
    parts = [f"noise of {settings.noise_k:g} K"]
    if settings.offset_sd_k > 0:
        parts.append(f"an offset between regions of {settings.offset_sd_k:g} K")
    sds = {settings.emissivity_sd, *settings.own_emissivity_sd.values()} - {0.0}
    parts += [f"an emissivity of ±{sd:.3f}" for sd in sorted(sds)]
    doubts = {
        "an irradiance scale": settings.scale_sd,
        "a light meter's factor": settings.factor_sd,
        "an exchange with the air": settings.exchange_sd,
    }
    if settings.model == "full":
        doubts |= {
            "a conductivity of the sand": settings.conductivity_sd,
            "its heat capacity": settings.capacity_sd,
        }
    parts += [f"{name} good to {sd:.0%}" for name, sd in doubts.items() if sd > 0]
    if settings.model == "paper":
        parts.append(f"and {PAPER_SCALE_SD:.0%} of scale for what the paper's model leaves out")
    return "covers " + ", ".join(parts)


def sd_words(sd: SdKind) -> str:
    """Which standard deviation is shown."""
    if sd == "paper":
        return "by eq. (9) as printed, with n outside the root: the standard error of the mean"
    return "the ordinary standard deviation of the absolute error"


def _bed_row(bed: Bed, material: Material) -> list[object]:
    answer, last = bed.final_estimate, bed.last
    truth = np.full(bed.tilt_deg.shape, bed.region.tilt_deg)
    mae = mean_absolute_error(bed.estimated_tilt_deg, truth)
    sd = sd_of_absolute_error(bed.estimated_tilt_deg, truth, material.sd)
    found = _found(answer) if answer else [formatting.UNKNOWN] * 5
    error = answer.tilt_deg - bed.region.tilt_deg if answer else float("nan")
    counted = int(np.isfinite(bed.estimated_tilt_deg).sum())
    return [
        element("strong", bed.region.name),
        formatting.given_slope(bed.region),
        *found,
        f"{error:+.1f}" if np.isfinite(error) else formatting.UNKNOWN,
        f"{mae:.1f} ± {sd:.2f}" if np.isfinite(mae) else formatting.UNKNOWN,
        counted,
        _state(answer, last),
    ]


def _state(answer: SlopeEstimate | None, last: SlopeEstimate | None) -> str:
    """The state of the slope that is shown, and of the last minute where that has another."""
    if last is None:
        return "no estimate"
    ended = formatting.state(last, second=False)
    shown = formatting.state(answer, second=False) if answer else ended
    return shown if shown == ended else f"{shown}; ended as: {ended}"


def _found(answer: SlopeEstimate) -> list[object]:
    return [
        formatting.tilt(answer),
        formatting.noise(answer),
        formatting.azimuth(answer),
        formatting.second_branch(answer) or formatting.UNKNOWN,
        formatting.number(answer.kelvin_per_degree, 2),
    ]


def over_time(material: Material) -> Html:
    """Slopes, temperatures and light over the session."""
    if not material.columns.time_ns.size:
        return section("Over the session", paragraph("No minute was recorded."))
    return section("Over the session", *_drawn(material, _time_figures))


def _time_figures(material: Material) -> Iterator[Html]:
    columns, site = material.columns, material.site
    clouds = " Grey: cloud or changing light." if columns.cloudy.any() else ""
    if columns.beds:
        yield figure(
            session_figures.tilts(columns, site),
            "Tilt of each bed. Shaded: 90 % likelihood region; dashed: the given tilt; crosses: not to be "
            f"relied on (held, shaded, no intersection); ticks at the foot: no slope.{clouds}",
            f"Tilt against local time. {_last_words(columns)}",
        )
    if material.settings.azimuth == "free" and columns.beds:
        yield figure(
            session_figures.azimuths(columns, site),
            "Azimuth of each bed's normal with its likelihood region; a region over all 360° means that "
            "the data do not tell. Dashed: the given azimuth.",
            "Azimuth of each bed against local time.",
        )
    yield figure(
        session_figures.temperatures(columns, material.channels, site),
        f"Surface temperature of the regions (camera) and contact probes (marks).{clouds}",
        f"Surface temperatures against local time of {', '.join(r.name for r in columns.regions)}.",
    )
    yield figure(
        session_figures.irradiance(columns, site),
        f"Above: illuminance as measured. Below: direct normal irradiance by the model "
        f"“{columns.irradiance_model}”.{clouds}",
        "Illuminance and derived direct normal irradiance against local time.",
    )


def _last_words(columns: Series) -> str:
    ends = [(bed.region.name, bed.final_estimate) for bed in columns.beds]
    return " ".join(f"{name} ends at {formatting.tilt(answer)}°." for name, answer in ends if answer)


def against_the_paper(material: Material) -> Html | str:
    """Figs. 12 and 13 of the paper for this session; nothing where no bed's slope was given."""
    columns = material.columns
    modelled = {
        bed.region.name: modelled_temperature(columns, bed, material.settings.surface) for bed in columns.beds
    }
    known = {name: kelvin for name, kelvin in modelled.items() if np.isfinite(kelvin).any()}
    with_truth = [bed for bed in columns.beds if np.isfinite(bed.region.tilt_deg)]
    if not known and not with_truth:
        return ""
    rmse = rmse_of(columns, known)
    text = paragraph(
        f"Measured against modelled surface temperature: RMSE {formatting.number(rmse, 2)} K over "
        f"{len(known)} beds (the paper reports 1.83 K for its own)."
    )
    return section("As in the paper", text, *_drawn(material, lambda m: _paper_figures(m, known, rmse)))


def rmse_of(columns: Series, modelled_k: dict[str, FloatArray]) -> float:
    """RMSE over all beds and minutes of measured against modelled surface temperature, kelvin."""
    if not modelled_k:
        return float("nan")
    measured = np.concatenate([columns.temperature_k[name] for name in modelled_k])
    return root_mean_square_error(measured, np.concatenate(list(modelled_k.values())))


def _paper_figures(material: Material, modelled: dict[str, FloatArray], rmse: float) -> Iterator[Html]:
    columns = material.columns
    if modelled:
        measured = {name: columns.temperature_k[name] for name in modelled}
        yield figure(
            paper_figures.measured_against_modelled(measured, modelled, rmse),
            f"As the paper's Fig. 12: measured surface temperature against eq. (7) with this session's "
            f"parameters. RMSE {rmse:.2f} K. Air temperature and long wave are not measured; the reference "
            "stands in for them through eq. (7), so it is not among the points.",
            f"Measured against modelled surface temperature, RMSE {rmse:.2f} kelvin.",
        )
    errors = {
        bed.region.name: errors_over_time(
            columns.of_day_ns(material.site),
            bed.estimated_tilt_deg,
            bed.region.tilt_deg,
            span_s=SPAN_S,
            kind=material.sd,
        )
        for bed in columns.beds
        if np.isfinite(bed.region.tilt_deg)
    }
    if any(errors.values()):
        yield figure(
            paper_figures.errors_over_local_time(errors, material.zone),
            f"As the paper's Fig. 13: absolute tilt error over local time, means over {SPAN_S / 60:.0f} min. "
            f"Bars: one SD, {sd_words(material.sd)}.",
            "Absolute tilt error of each bed against local time.",
        )


def _drawn(material: Material, draw: Callable[[Material], Iterator[Html]]) -> list[Html]:
    if not material.figures:
        return [paragraph(element("em", LAB_HINT))]
    return [element("div", *draw(material), class_="figures")]
