"""The error budget in words and numbers: how many degrees each cause may cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from fieldkit.views import words
from fieldkit.views.html import Html, bullets, paragraph, section, table
from fieldkit.views.report.budget import BedBudget, budget
from fieldkit.views.report.material import Material
from fieldkit.views.report.verdict import mean_error

OFFSET_K = 0.3
SCALE = 0.10
READING = (
    "to first order and with the azimuth known; in brackets what the cause amounts to in eq. (6). "
    "Plus: the bed looks more turned to the sun."
)
"""How the table is to be read."""


def error_budget(material: Material) -> Html | str:
    """The section; nothing without beds or without irradiance."""
    if not material.columns.beds or not np.isfinite(material.columns.irradiance_w_m2).any():
        return ""
    budgets = [budget(material.columns, bed, material.settings) for bed in material.columns.beds]
    return section(
        "Error budget",
        paragraph(_left_out_words(material, budgets)),
        table(
            ("cause", *(found.name for found in budgets)),
            cause_rows(budgets),
            caption=f"Degrees of tilt, medians over the session, {READING}",
        ),
        bullets(_advice(budgets)),
    )


def cause_rows(budgets: Sequence[BedBudget]) -> list[list[object]]:
    """Rows of the table: a cause, and what it costs each bed."""
    terms: list[tuple[str, Callable[[BedBudget], float]]] = [
        ("left out: light of the sky", lambda b: b.diffuse_w_m2),
        ("left out: light from the ground", lambda b: b.reflected_w_m2),
        ("left out: long wave of sky and ground", lambda b: b.longwave_w_m2),
        ("left out: heat stored in the sand", lambda b: b.storage_w_m2),
        ("all that is left out", lambda b: b.left_out_w_m2),
    ]
    found: list[list[object]] = [[name, *(_degrees(b, of(b)) for b in budgets)] for name, of in terms]
    found.append(["half the likelihood region", *(f"±{words.number(b.noise_deg, 1)}°" for b in budgets)])
    found.append(
        [
            f"{OFFSET_K:g} K between bed and reference",
            *(f"±{words.number(abs(b.of_offset(OFFSET_K)), 1)}°" for b in budgets),
        ]
    )
    found.append(
        [
            f"irradiance wrong by {SCALE:.0%}",
            *(f"±{words.number(abs(b.of_scale(SCALE)), 1)}°" for b in budgets),
        ]
    )
    return [*found, *_calibrated(budgets)]


def _calibrated(budgets: Sequence[BedBudget]) -> Iterator[list[object]]:
    """Rows of what calibration records leave uncertain, one standard uncertainty of each."""
    causes: dict[str, Callable[[BedBudget], tuple[float, str]]] = {
        "emissivity as calibrated": lambda b: (b.of_offset(b.emissivity_k), f"{b.emissivity_k:.2f} K"),
        "light meter as calibrated": lambda b: (b.of_scale(b.factor_sd), f"{b.factor_sd:.1%}"),
    }
    for name, of in causes.items():
        cells = [of(one) for one in budgets]
        if any(degrees for degrees, _ in cells):
            yield [name, *(f"±{words.number(abs(degrees), 1)}° ({amount})" for degrees, amount in cells)]


def _degrees(found: BedBudget, term_w_m2: float) -> str:
    degrees = found.degrees(term_w_m2)
    if not np.isfinite(degrees):
        return words.UNKNOWN
    return f"{degrees:+.1f}° ({term_w_m2:+.0f} W/m²)"


def _left_out_words(material: Material, budgets: Sequence[BedBudget]) -> str:
    settings, slab = material.settings, material.settings.slab
    costs = [abs(found.degrees(found.left_out_w_m2)) for found in budgets]
    known = [cost for cost in costs if np.isfinite(cost)]
    cost = words.number(float(np.mean(known)) if known else float("nan"), 1)
    left_out = (
        "The paper's model, eq. (6), knows direct sunlight, and an exchange with air and sky that bed and "
        "reference share. A tilted bed also sees less sky and more ground, and its sand takes up heat at "
        "another pace: diffuse light, sky long wave and storage are left out. With "
        f"{settings.diffuse_fraction:.0%} of the light diffuse, {settings.longwave_down_w_m2:.0f} W/m² of "
        f"long wave from the sky and {slab.depth_m * 100:g} cm of sand these terms feign {cost}° of tilt "
        "here, on average over the beds; they partly cancel."
    )
    if settings.model == "full":
        return left_out + " These slopes were estimated with the full model, which has them."
    if material.full is None:
        return left_out
    with_full, without = mean_error(material.full), mean_error(material.columns)
    if not np.isfinite(with_full):
        return left_out
    return (
        f"{left_out} Estimated again with them (model “full”), the mean tilt error is {with_full:.1f}° "
        f"instead of {without:.1f}°."
    )


def _advice(budgets: Sequence[BedBudget]) -> list[str]:
    weakest = min(budgets, key=lambda found: np.nan_to_num(abs(found.kelvin_per_degree), nan=np.inf))
    offset_deg = words.number(abs(weakest.of_offset(OFFSET_K)), 1)
    return [
        f"Offsets between regions do not average away. {weakest.name} has "
        f"{words.number(weakest.kelvin_per_degree, 2)} K per degree: {OFFSET_K:g} K cost {offset_deg}°. "
        "A uniform target before and after the session measures them (fieldkit calibrate uniformity).",
        "Noise averages over a longer window; the other doubts in the likelihood region do not. The azimuth "
        "needs an hour or more of sun motion.",
        "A wrong scale of the irradiance (lux meter, model, albedo, heat exchange) stretches all tilts "
        "alike; one bed of known slope calibrates it.",
    ]
