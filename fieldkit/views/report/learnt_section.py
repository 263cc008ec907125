"""Learnt parameters in a report: parameters before and after, over the session, and the residuals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from fieldkit.model.learnt import Learnt, LearntParameter
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
    assert learnt is not None
    sure = learnt_words.confidence(learnt)
    words = "; ".join(
        f"{parameter.name} {learnt_words.value_text(parameter)}" for parameter in learnt.parameters
    )
    yield Figure(
        _prior_and_posterior(learnt),
        f"Each parameter on the scale of its prior: {sure} intervals before (grey) and after the data "
        "(blue), with medians. Where both are equally long, the data added nothing.",
        f"Parameters before and after the data: {words}.",
    )
    if learnt_words.main(learnt):
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


# Prior against posterior, and learning over the session


def _prior_and_posterior(learnt: Learnt) -> str:
    """Each parameter's interval after the data, on the scale of its prior's."""
    figure, (axes,) = plotting.panels(1, 1.1 + 0.38 * len(learnt.parameters))
    for row, parameter in enumerate(learnt.parameters):
        _interval(axes, row, parameter)
    names = [learnt_words.SHORT.get(parameter.name, parameter.name) for parameter in learnt.parameters]
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_axisbelow(True)
    axes.set_xticks([-1.0, 0.0, 1.0], ["low", "median", "high"])
    axes.set_xlabel(f"{learnt_words.confidence(learnt)} interval of the prior")
    return plotting.svg(figure)


def _over_time(columns: Series, site: Site) -> plotting.OverTime:
    """The main parameters by minute with their intervals, a panel each; `columns` must have some."""
    names = [parameter.name for parameter in learnt_words.main(columns.final_learnt)]
    figure, panels = plotting.panels(len(names), 0.6 + 1.1 * len(names))
    for index, (axes, name) in enumerate(zip(panels, names, strict=True)):
        _learning(axes, columns, name, plotting.colour(index))
    return over_time(figure, panels, columns, site, legend=False)


def _interval(axes: Axes, row: int, parameter: LearntParameter) -> None:
    """The prior's interval as a wide grey bar, the posterior's as a narrow one with its median."""
    low, value, high = (
        _on_prior(parameter, number) for number in (parameter.low, parameter.value, parameter.high)
    )
    axes.barh(row, 2.0, left=-1.0, height=0.62, color=PRIOR_COLOUR)
    axes.barh(row, high - low, left=low, height=0.26, color=plotting.colour(0))
    axes.plot(value, row, marker="|", markersize=13, markeredgewidth=2.2, color="black")


def _on_prior(parameter: LearntParameter, number: float) -> float:
    """A number where the prior's median is 0 and the ends of its interval are -1 and 1."""
    away = number - parameter.prior
    half = parameter.prior_high - parameter.prior if away > 0 else parameter.prior - parameter.prior_low
    return away / half if half > 0 else 0.0


def _learning(axes: Axes, columns: Series, name: str, colour: str) -> None:
    parameters = [learnt_words.by_name(learnt).get(name) for learnt in columns.learnt]
    ends = [(known.low, known.value, known.high) if known else (np.nan,) * 3 for known in parameters]
    days, low, value, high = plotting.broken(columns.time_ns, *np.transpose(ends))
    last = next(parameter for parameter in reversed(parameters) if parameter is not None)
    axes.axhspan(last.prior_low, last.prior_high, color=PRIOR_COLOUR, alpha=0.5, linewidth=0)
    axes.fill_between(days, low, high, color=colour, alpha=0.35, linewidth=0)
    axes.plot(days, value, color=colour, linewidth=1.6)
    axes.set_ylabel(learnt_words.short(last))
