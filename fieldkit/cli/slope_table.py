"""Slopes in the terminal: one line per bed, against truth where it is known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from fieldkit.cli import common
from fieldkit.model.site import Region
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.views import formatting

COLUMNS = ("bed", "truth", "tilt", "noise", "error", "azimuth", "K per °", "chi²", "state")
MEANING = (
    "±: larger half of the 90 % region, stated doubts of scale and offset included; noise: by noise alone"
)


def print_slopes(answers: Mapping[str, SlopeEstimate], regions: Sequence[Region]) -> None:
    """Print the answer for each target."""
    by_name = {region.name: region for region in regions}
    common.print_table(COLUMNS, [_row(answer, by_name[name]) for name, answer in answers.items()])


def explain_slopes(answers: Iterable[SlopeEstimate]) -> None:
    """Say once, under the tables, what their ± cover and what they do not."""
    found = [one for one in answers if math.isfinite(one.tilt_deg)]
    if found:
        common.say(MEANING)
    if any(one.state is SlopeState.UNCERTAIN for one in found):
        common.say(f"uncertain: {formatting.UNCERTAIN_MEANS}")
    if any(one.model.startswith("paper") and "azimuth known" not in one.model for one in found):
        common.say(formatting.PAPER_OMITS)


def _row(answer: SlopeEstimate, region: Region) -> tuple[str, ...]:
    error = answer.tilt_deg - region.tilt_deg
    return (
        answer.region,
        formatting.given_slope(region),
        f"{formatting.tilt(answer)}°",
        formatting.noise(answer),
        f"{error:+.1f}°" if math.isfinite(error) else formatting.UNKNOWN,
        formatting.azimuth(answer),
        formatting.number(answer.kelvin_per_degree, 2),
        formatting.number(answer.chi_square, 1),
        formatting.state(answer),
    )
