"""The study on one page: its conditions, tables and figures, and where it differs from the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fieldkit.views import formatting
from fieldkit.views.html import Figure, Table, render

CAPTIONS = {
    "figure-05": "Fig. 5: light on a slope less that on flat ground, at noon.",
    "figure-06": "Fig. 6: one measured difference is explained by every slope on its contour.",
    "figure-07": "Fig. 7: contours at 12:00, 12:30 and 13:00 meet at the true slope, 10°/180°.",
    "figure-08": "Fig. 8: score of every slope; a cell counts within 2 W/m² of a contour.",
    "figure-09": "Fig. 9: share of slopes estimated within an absolute tilt error",
    "figure-10": "Fig. 10: mean absolute tilt error, degrees, by direction of the slope",
    "figure-12": "Fig. 12: measured against modelled surface temperature",
    "figure-13": "Fig. 13: absolute tilt error over local time, 20 minutes each, bars SD by eq. (9)",
    "figure-14": "Fig. 14: a cloud at 13:00 that the table does not contain: no common point.",
}
TITLES = {
    "errors": "Errors by start and estimator, degrees",
    "table-2": "Table 2: incidence angles, degrees, computed and printed",
    "sensitivity": "90th percentile of the tilt error by assumptions that the paper does not state",
    "field": "Field experiment",
}


def page(
    about: Mapping[str, Any], tables: Mapping[str, Sequence[Mapping[str, Any]]], figures: Mapping[str, str]
) -> str:
    """The whole page as one self-contained HTML text."""
    conditions = (
        f"{about['day']}, {about['minutes']} min windows, {about['irradiance']}, noise {about['noise_k']:g} K"
    )
    return render(
        "study.html",
        conditions=conditions,
        tables=[(TITLES[name], _table(tables[name])) for name in TITLES if tables.get(name)],
        drawn=[Figure(svg, _caption(name), _caption(name)) for name, svg in sorted(figures.items())],
    )


def _caption(name: str) -> str:
    kind, which = name[:9], name[10:]
    return f"{CAPTIONS[kind]} ({which})" if which else CAPTIONS[kind]


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = [column.replace("_", " ") for column in rows[0]]
    return Table(columns, [[_cell(value) for value in row.values()] for row in rows])


def _cell(value: object) -> str:
    if isinstance(value, float):
        return (
            formatting.UNKNOWN
            if value != value
            else "<0.001"
            if 0 < value < 0.001
            else f"{round(value, 3):g}"
        )
    return str(value)
