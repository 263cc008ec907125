"""Learnt parameters in a report: before and after, over the session, and the residuals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.model.site import Site
from fieldkit.views import learnt_words, plotting
from fieldkit.views.html import Figure, Table, bar
from fieldkit.views.report.series import ReportData, Series, figure_over_time
from fieldkit.views.report.session_figures import over_time

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PRIOR_COLOUR = "#D0D0D0"


def learnt_section(data: ReportData) -> Mapping[str, object] | None:
    """The section of a session as the template shows it; None with other models than the learned."""
    learnt = data.columns.final_learnt
    if learnt is None:
        return None
    return {
        "judgement": learnt_words.judgement(learnt),
        "parameters": Table(
            learnt_words.COLUMNS, learnt_words.rows(learnt, bar), learnt_words.meaning(learnt)
        ),
        "figures": data.draw(_figures),
        "residuals": Table(learnt_words.RESIDUAL_COLUMNS, learnt_words.residual_rows(learnt)),
    }


def _figures(data: ReportData) -> Iterator[Figure]:
    learnt = data.columns.final_learnt
    if learnt is not None and learnt_words.main(learnt):
        sure = learnt_words.confidence(learnt)
        yield figure_over_time(
            data,
            _over_time(data.columns, data.site),
            f"Parameters by minute with {sure} intervals; grey: the prior.",
            "Parameters against local time, their intervals narrowing from the prior's.",
            lambda minute: _learnt_at(data, minute),
            wide=False,
        )


def _learnt_at(data: ReportData, minute: int) -> Iterator[str]:
    for parameter in learnt_words.main(data.columns.learnt[minute]):
        yield f"{learnt_words.short(parameter)}: {learnt_words.value_text(parameter)}"


def _over_time(columns: Series, site: Site) -> plotting.OverTime:
    """The main parameters by minute with their intervals, a panel each; `columns` must have some."""
    names = [parameter.name for parameter in learnt_words.main(columns.final_learnt)]
    figure, panels = plotting.panels(len(names), 0.6 + 1.1 * len(names))
    for index, (axes, name) in enumerate(zip(panels, names, strict=True)):
        _learning(axes, columns, name, plotting.colour(index))
    return over_time(figure, panels, columns, site, legend=False)


def _learning(axes: Axes, columns: Series, name: str, colour: str) -> None:
    parameters = [learnt_words.by_name(learnt).get(name) for learnt in columns.learnt]
    ends = [(known.low, known.value, known.high) if known else (np.nan,) * 3 for known in parameters]
    days, low, value, high = plotting.broken(columns.time_ns, *np.transpose(ends))
    last = next(parameter for parameter in reversed(parameters) if parameter is not None)
    axes.axhspan(last.prior_low, last.prior_high, color=PRIOR_COLOUR, alpha=0.5, linewidth=0)
    axes.fill_between(days, low, high, color=colour, alpha=0.35, linewidth=0)
    axes.plot(days, value, color=colour, linewidth=1.6)
    axes.set_ylabel(learnt_words.short(last))
