"""Slopes in the terminal: one line per region, against its true slope where that is known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import compress

import click

from fieldkit.cli import common
from fieldkit.model.learnt import Learnt
from fieldkit.model.site import Region
from fieldkit.model.slope import CERTAIN, SHORT_FIELDS, ReferenceCheck, SlopeEstimate
from fieldkit.views import formatting, learnt_words

SHORT = tuple(field.short for field in SHORT_FIELDS)
COLUMNS = ("region", "truth", "tilt", "noise", "error", "azimuth", *SHORT, "state")


def print_slopes(
    estimates: Mapping[str, SlopeEstimate],
    regions: Sequence[Region],
    learnt: Learnt | None = None,
    checks: Iterable[ReferenceCheck] = (),
) -> None:
    """Print the final estimate of each target, what was learnt, the findings, and reasons to doubt them.

    Each reference follows, as all others show it.
    """
    by_name = {region.name: region for region in regions}
    rows = [_row(estimate, by_name[name]) for name, estimate in estimates.items()]
    has_values = [any(cell != formatting.UNKNOWN for cell in column) for column in zip(*rows, strict=True)]
    common.print_table(list(compress(COLUMNS, has_values)), [list(compress(row, has_values)) for row in rows])
    print_learnt(learnt)
    if words := formatting.findings(estimates.values(), regions):
        common.say(words)
    for name, estimate in estimates.items():
        if estimate.reason and estimate.state not in CERTAIN:
            common.say(f"{name}: {estimate.reason}")
    for check in checks:
        click.echo(formatting.reference_check(check))


def print_learnt(learnt: Learnt | None) -> None:
    """Print what was learnt, each parameter before and after; nothing with other models."""
    if learnt is None:
        return
    common.print_table(learnt_words.COLUMNS, learnt_words.rows(learnt))
    common.say(learnt_words.judgement(learnt))


def explain_slopes(estimates: Iterable[SlopeEstimate]) -> None:
    """Print once, under the tables, what their ± include and what they do not."""
    solved = [estimate for estimate in estimates if math.isfinite(estimate.tilt_deg)]
    if solved:
        noise = "; noise: without" if any(math.isfinite(slope.noise_tilt_low_deg) for slope in solved) else ""
        words = formatting.region_words(formatting.confidence(solved))
        common.say(f"{words}, with systematic uncertainties of scale and offset{noise}")
    if any(slope.model.startswith("paper") and "azimuth known" not in slope.model for slope in solved):
        common.say(formatting.PAPER_OMITS)


def _row(estimate: SlopeEstimate, region: Region) -> tuple[str, ...]:
    error = estimate.tilt_deg - region.tilt_deg
    return (
        estimate.region,
        formatting.given_slope(region),
        formatting.tilt_degrees(estimate),
        formatting.noise(estimate),
        f"{error:+.1f}°" if math.isfinite(error) else formatting.UNKNOWN,
        formatting.azimuth(estimate),
        *formatting.short_columns(estimate),
        formatting.state(estimate),
    )
