"""Slopes in the terminal: one line per region, against its true slope where that is known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from fieldkit.cli import common
from fieldkit.model.learnt import Learnt
from fieldkit.model.site import Region
from fieldkit.model.slope import SHORT_FIELDS, SlopeEstimate, SlopeState
from fieldkit.views import formatting, learnt_words

SHORT = tuple(field.short for field in SHORT_FIELDS)
COLUMNS = ("region", "truth", "tilt", "noise", "error", "azimuth", *SHORT, "state")


def print_slopes(estimates: Mapping[str, SlopeEstimate], regions: Sequence[Region]) -> None:
    """Print the final estimate of each target."""
    by_name = {region.name: region for region in regions}
    common.print_table(COLUMNS, [_row(estimate, by_name[name]) for name, estimate in estimates.items()])


def print_learnt(learnt: Learnt | None) -> None:
    """Print what was learnt, each parameter before and after; nothing with other models."""
    if learnt is None:
        return
    common.print_table(learnt_words.COLUMNS, learnt_words.rows(learnt))
    common.say(learnt_words.judgement(learnt))


def explain_slopes(estimates: Iterable[SlopeEstimate]) -> None:
    """Print once, under the tables, what their ± include and what they do not."""
    estimates = tuple(estimates)
    for estimate in estimates:
        if math.isfinite(estimate.along_sun_deg):
            common.say(f"{estimate.region}: {estimate.reason}")
    solved = [estimate for estimate in estimates if math.isfinite(estimate.tilt_deg)]
    sure = formatting.confidence(solved)
    if solved:
        common.say(
            f"±: larger half of the {sure} region, "
            "with systematic uncertainties of scale and offset; noise: without"
        )
    if any(slope.state is SlopeState.WIDE for slope in solved):
        common.say(f"wide: {formatting.wide_means(sure)}")
    if any(slope.model.startswith("paper") and "azimuth known" not in slope.model for slope in solved):
        common.say(formatting.PAPER_OMITS)


def _row(estimate: SlopeEstimate, region: Region) -> tuple[str, ...]:
    error = estimate.tilt_deg - region.tilt_deg
    return (
        estimate.region,
        formatting.given_slope(region),
        f"{formatting.tilt(estimate)}°",
        formatting.noise(estimate),
        f"{error:+.1f}°" if math.isfinite(error) else formatting.UNKNOWN,
        formatting.azimuth(estimate),
        *formatting.short_columns(estimate),
        formatting.state(estimate),
    )
