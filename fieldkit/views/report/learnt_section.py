"""Learnt parameters in a report: parameters before and after, over the session, and the residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fieldkit.views import learnt_words
from fieldkit.views.html import Figure, Table, bar
from fieldkit.views.report import learnt_figures
from fieldkit.views.report.readings import readings
from fieldkit.views.report.report_data import ReportData


@dataclass(frozen=True, slots=True)
class LearntSection:
    """The section as the template shows it; `figures` is None without matplotlib."""

    judgement: str
    parameters: Table
    figures: Sequence[Figure] | None
    residuals: Table


def learnt_section(data: ReportData) -> LearntSection | None:
    """The section of a session; None with other models than the learned."""
    learnt = data.columns.final_learnt
    if learnt is None:
        return None
    return LearntSection(
        learnt_words.judgement(learnt),
        Table(learnt_words.COLUMNS, learnt_words.rows(learnt, bar), learnt_words.meaning(learnt)),
        data.drawn(_figures),
        Table(learnt_words.RESIDUAL_COLUMNS, learnt_words.residual_rows(learnt)),
    )


def _figures(data: ReportData) -> Iterator[Figure]:
    learnt = data.columns.final_learnt
    assert learnt is not None
    sure = learnt_words.confidence(learnt)
    words = "; ".join(f"{one.name} {learnt_words.found(one)}" for one in learnt.parameters)
    yield Figure(
        learnt_figures.prior_and_posterior(learnt),
        f"Each parameter on the scale of its prior: grey the {sure} interval before the data, blue after "
        "them, with the medians. A blue bar as long as the grey one: the data added nothing.",
        f"Parameters before and after the data: {words}.",
    )
    if learnt_words.main(learnt):
        drawn = learnt_figures.over_time(data.columns, data.site)
        yield Figure(
            drawn.svg,
            f"What was known by each minute, with {sure} intervals; grey: the prior.",
            "Parameters against local time, their intervals narrowing from the prior's.",
            readings=readings(drawn, data.columns, data.site, lambda minute: _learnt_at(data, minute)),
        )


def _learnt_at(data: ReportData, minute: int) -> Iterator[str]:
    for one in learnt_words.main(learnt) if (learnt := data.columns.learnt[minute]) else ():
        yield f"{learnt_words.short(one)}: {learnt_words.found(one)}"
