"""The study on one page: what was asked, the tables, the figures, and where the paper differs and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fieldkit.views import html

CAPTIONS = {
    "figure-05": "Fig. 5: light on a slope less that on flat ground, at noon.",
    "figure-06": "Fig. 6: one measured difference is explained by every slope on its contour.",
    "figure-07": "Fig. 7: contours at 12:00, 12:30 and 13:00 meet at the true slope, 10°/180°.",
    "figure-08": "Fig. 8: score of every slope; a cell counts within 2 W/m² of a contour.",
    "figure-09": "Fig. 9: share of slopes estimated within an absolute tilt error",
    "figure-10": "Fig. 10: mean absolute tilt error, degrees, by direction of the slope",
    "figure-12": "Fig. 12: measured against modelled surface temperature",
    "figure-13": "Fig. 13: absolute tilt error over local time, 20 minutes each, bars SD by eq. (9)",
    "figure-14": "Fig. 14: a cloud at 13:00 that the table does not know of: no common point.",
}
TITLES = {
    "table-2": "Table 2: incidence angles, degrees, computed and printed",
    "errors": "Errors by start and estimator, degrees",
    "sensitivity": "90th percentile of the tilt error by what the paper does not tell",
    "field": "Field experiment",
}
DIFFERENCES = (
    "The paper took direct irradiance, air temperature and long wave from a data set that is not public; "
    "here they are as stated above. Nothing was adjusted to meet the paper's figures.",
    "The paper's slopes are the cells of its own search grid, so that contour scoring always has the truth "
    "among its answers; slopes off the grid (--slopes 3000) are estimated worse.",
    "Least squares without noise is exact but for slopes with a twin that explains the same minutes: look at "
    "the standard deviation and the largest error beside the percentiles.",
    "The paper does not say when a cell is on a contour nor how ties are resolved: here within the stated "
    "tolerance, tied cells averaged as normals.",
    "With any one clear sky noon is the best of the three starts; the paper's order (9 h before 12 h before "
    "15 h) needs a weaker beam at noon and later.",
    "One cell of Table 2 is 49.55 and was printed 49.5.",
    "Figs. 12 and 13 show the paper's beds under a simulated clear sky unless sessions were given: diffuse "
    "light, long wave, wind and stored heat are in that sky and not in the paper's model.",
)


def page(
    about: Mapping[str, Any], tables: Mapping[str, Sequence[Mapping[str, Any]]], figures: Mapping[str, str]
) -> str:
    """The whole page as one self-contained HTML text."""
    asked = (
        f"{about['day']}, {about['minutes']} min windows, {about['irradiance']}, noise {about['noise_k']:g} K"
    )
    shown = [html.section(TITLES[name], _table(tables[name])) for name in TITLES if tables.get(name)]
    drawn = [html.figure(svg, _caption(name), _caption(name)) for name, svg in figures.items()]
    return html.page(
        "Simulation study",
        html.element("h1", "Simulation study"),
        html.paragraph(asked, class_="facts"),
        html.section("Where this differs from the paper, and why", html.bullets(DIFFERENCES)),
        *shown,
        html.section("Figures", html.element("div", *drawn, class_="figures"))
        if drawn
        else html.paragraph("Figures need matplotlib: pip install 'fieldkit[lab]'."),
    )


def _caption(name: str) -> str:
    kind, which = name[:9], name[10:]
    return f"{CAPTIONS[kind]} ({which})" if which else CAPTIONS[kind]


def _table(rows: Sequence[Mapping[str, Any]]) -> html.Html:
    columns = [column.replace("_", " ") for column in rows[0]]
    return html.table(columns, [[_cell(value) for value in row.values()] for row in rows])


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "–" if value != value else f"{value:.4g}"
    return str(value)
