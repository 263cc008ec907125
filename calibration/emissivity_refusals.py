"""When pairs of camera and thermometer do not tell an emissivity, and what would."""

from __future__ import annotations

from scipy import stats

from fieldkit.calibration.budget import COVERAGE_FACTOR, Contribution
from fieldkit.model.errors import CalibrationError

MIN_PAIRS = 3
MIN_CONTRAST_K = 10.0
"""Between surface and reflected temperature, ASTM E1933's usual rule."""
GOOD_CONTRAST_K = 25.0
MIN_SPAN_K = 15.0
"""Of surface temperatures, to find the reflected temperature as well."""
LARGEST_UNCERTAINTY = 0.05
"""Standard uncertainty beyond which an emissivity says nothing about soils, 0.85 to 0.98."""
UNLIKELY = 1e-3
LEAST_SOIL, MOST_SOIL = 0.6, 1.02
DARK = 0.985


def refuse_before(
    pairs: int, contrast_k: float, reflected_sd_k: float, span_k: float, reflected_is_free: bool
) -> None:
    """Raise `CalibrationError` if what was measured cannot tell, whatever it says.

    The surface must be clear of what it mirrors by 10 K, and by three uncertainties of that.
    """
    if pairs < MIN_PAIRS:
        raise CalibrationError(
            f"{pairs} steady pair{'s' * (pairs != 1)} cannot show whether they agree",
            fix=f"measure at {MIN_PAIRS} temperatures or more, each steady for a minute",
        )
    least_k = max(MIN_CONTRAST_K, 3.0 * reflected_sd_k)
    if contrast_k < least_k:
        raise CalibrationError(
            f"the surface is only {contrast_k:.0f} K from what it mirrors, not {least_k:.0f} K: "
            "its emissivity hardly shows",
            fix="heat the sample, or go outdoors under a clear sky; 25 K or more is good",
        )
    if reflected_is_free and span_k < MIN_SPAN_K:
        raise CalibrationError(
            f"the surface spans {span_k:.0f} K: emissivity and reflected temperature cannot be told apart",
            fix=f"measure over {MIN_SPAN_K:.0f} K or more, or measure the reflected temperature with foil",
        )


def agree(chi_square: float, freedom: int) -> bool:
    """Whether pairs scatter about their line as their uncertainties say."""
    return freedom <= 0 or float(stats.chi2.sf(chi_square, freedom)) >= UNLIKELY


def refuse_after(
    value: float, standard: float, worst: Contribution, chi_square: float, freedom: int, in_fahrenheit: float
) -> tuple[str, ...]:
    """Raise `CalibrationError` if the fit contradicts the model or tells too little; else the doubts left.

    `in_fahrenheit` is the emissivity that a thermometer showing °F would give, NaN where that fits no better.
    """
    is_impossible = value > 1.0 + COVERAGE_FACTOR * standard
    disagrees = not agree(chi_square, freedom)
    if (is_impossible or disagrees or value < LEAST_SOIL) and LEAST_SOIL <= in_fahrenheit <= MOST_SOIL:
        raise CalibrationError(
            f"the emissivity would be {value:.2f}; read as °F the thermometer gives {in_fahrenheit:.2f}",
            fix="the thermometer shows °F, it seems: set it to °C, or give --unit F",
        )
    if is_impossible:
        raise CalibrationError(
            f"the emissivity would be {value:.2f}, which cannot be",
            fix="does the camera apply an emissivity already (it must be 1)? is the probe in this region, "
            "the camera's offset checked, the foil under the same sky?",
        )
    if disagrees:
        raise CalibrationError(
            "the pairs disagree by more than their uncertainties (chi-square "
            f"{chi_square / freedom:.1f} per degree of freedom)",
            fix="look for unsteady moments, a probe outside the region, clocks that differ between logs, "
            "or a reflected temperature from another sky",
        )
    if standard > LARGEST_UNCERTAINTY:
        raise CalibrationError(
            f"the emissivity would be {value:.2f} ± {COVERAGE_FACTOR * standard:.2f} (k=2): not determined",
            fix=f"the largest contribution is {worst.name} ({abs(worst.effect):.3f}): work on it first, "
            "or make the surface warmer against what it mirrors",
        )
    if value > DARK:
        return ("blacker than any dry soil: check that the camera applies no emissivity of its own",)
    return ()
