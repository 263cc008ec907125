"""The whole study: simulated runs, the field days, and what is written of both.

Tables as CSV and JSON, figures as SVG, and one page with all of it.

>>> paper_study(StudyOptions(slopes=400)).to_frame()          # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime, time
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import NoAnswerError, StorageError, os_errors_as
from fieldkit.model.next_step import Argument
from fieldkit.physics.facet import normal
from fieldkit.results.json_document import to_json
from fieldkit.results.sun_angles import sun_rows
from fieldkit.sessions.formats.tables_out import write_csv
from fieldkit.study.estimators import Conditions, summarise
from fieldkit.study.field_days import FieldDay, field_days
from fieldkit.study.runs import PAPER_SITE, Run, StudyOptions, conditions, run_all, sensitivity
from fieldkit.views import formatting, plotting, study_figures
from fieldkit.views.html import Figure, Table, render
from fieldkit.views.report.series import temperature_rmse_k
from fieldkit.views.study_figures import errors_over_local_time, measured_against_modelled

if TYPE_CHECKING:
    import pandas as pd

Rows = list[dict[str, Any]]
PAPER = StudyOptions()
EXAMPLE = (10.0, 180.0)
"""Tilt and direction of the slope in the paper's Figs. 6 to 8."""

PAPER_P90_DEG = {"09:00": 0.43, "12:00": 0.62, "15:00": 0.90}
PAPER_TABLE_2 = {
    ("2017-08-30", 0): (26.9, 31.9, 41.0, 52.1),
    ("2017-08-30", 10): (17.1, 24.7, 36.5, 49.5),
    ("2017-08-30", 20): (7.8, 19.9, 34.1, 48.5),
    ("2017-12-11", 0): (58.8, 61.9, 67.8, 75.9),
    ("2017-12-11", 5): (53.9, 57.3, 63.8, 72.6),
    ("2017-12-11", 15): (44.0, 48.2, 56.0, 66.2),
    ("2017-12-11", 25): (34.1, 39.4, 48.7, 60.2),
}
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


@dataclass(frozen=True)
class PaperStudy:
    """Result of a study: a run for each start and estimator, the field days, and the sensitivity rows."""

    options: StudyOptions
    runs: Sequence[Run]
    days: Sequence[FieldDay]
    sensitivity: Rows

    @cached_property
    def tables(self) -> dict[str, Rows]:
        """All tables by name, each a list of rows."""
        return {
            "table-2": table_2(),
            "errors": summary_rows(self.runs),
            "directions": direction_rows(self.runs),
            "sensitivity": self.sensitivity,
            "field": [
                {"day": day.name, "rmse_k": day.rmse_k, "mean_tilt_error_deg": day.mean_error_deg}
                for day in self.days
            ],
            "field-errors": [
                {
                    "bed": bed,
                    "hours_after_midnight": span.start_ns / 3.6e12,
                    "mean_deg": span.mean,
                    "sd_paper_deg": span.sd,
                    "n": span.count,
                }
                for day in self.days
                for bed, spans in day.errors.items()
                for span in spans
            ],
        }

    @property
    def document(self) -> dict[str, Any]:
        """The options and the short tables, as in ``study.json`` and with ``--json``."""
        options, tables = self.options, ("table-2", "errors", "directions", "sensitivity", "field")
        numbers = ("minutes", "irradiance", "noise_k", "quantum_k", "tolerance_w_m2", "seed")
        return {
            "site": asdict(options.site),
            "day": str(options.day),
            **{name: getattr(options, name) for name in numbers},
            **{name.replace("-", "_"): self.tables[name] for name in tables},
        }

    def to_frame(self) -> pd.DataFrame:
        """Errors by start and estimator, degrees, as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        return pd.DataFrame(self.tables["errors"])

    def write(self, folder: str | Path) -> None:
        """Write tables, figures and a page with all of them; raises `StorageError`."""
        drawn = self._figures() if plotting.available() else {}
        texts = {"study.json": to_json(self.document), "study.html": self._page(drawn)}
        _write_files(Path(folder), texts, self.tables, drawn)

    def _figures(self) -> dict[str, str]:
        """Figures by name as SVG text."""
        drawn = _of_the_method(self.options)
        for method in self.options.estimators:
            mine = [run for run in self.runs if run.method == method]
            errors = {run.begin: run.outcome.tilt_error_deg for run in mine}
            drawn[f"figure-09-{method}"] = study_figures.cumulative(errors)
            turned = {run.begin: run.outcome.by_direction() for run in mine}
            drawn[f"figure-10-{method}"] = study_figures.directions(turned)
        return drawn | _of_the_field(self.days)

    def _page(self, figures: Mapping[str, str]) -> str:
        """Conditions, tables and figures as one self-contained page."""
        options, tables = self.options, self.tables
        return render(
            "study.html",
            conditions=f"{options.day}, {options.minutes} min windows, {options.irradiance}, "
            f"noise {options.noise_k:g} K",
            tables=[(TITLES[name], _as_table(tables[name])) for name in TITLES if tables.get(name)],
            drawn=[Figure(svg, _caption(name), _caption(name)) for name, svg in sorted(figures.items())],
        )


def paper_study(
    options: StudyOptions = PAPER,
    *,
    sessions: Sequence[Path] = (),
    with_sensitivity: bool = False,
    on_stage: Callable[[str], None] = lambda _: None,
) -> PaperStudy:
    """Reproduce sections 2–5 of the paper.

    `sessions` are recordings for the field figures, instead of the paper's days under a simulated sky.
    `with_sensitivity` repeats the runs for several irradiances and tolerances, which the paper does not
    state. `on_stage` receives the name of each stage as it begins. Raises `NoAnswerError` if the sun is down,
    or no weather was measured, during a window.
    """
    runs = run_all(options)
    on_stage("field")
    days = field_days(sessions)
    on_stage("tables and figures")
    return PaperStudy(options, runs, days, sensitivity(options) if with_sensitivity else [])


def table_2() -> Rows:
    """The paper's Table 2, computed and printed, one row per date and tilt, degrees."""
    rows = []
    for (day, tilt), printed in PAPER_TABLE_2.items():
        hours = tuple(datetime.fromisoformat(f"{day}T{hour}:00+09:00") for hour in (12, 13, 14, 15))
        angles = [row["facets"][0]["incidence_deg"] for row in sun_rows(PAPER_SITE, hours, ((tilt, 180.0),))]
        row: dict[str, Any] = {"date": day, "tilt_deg": tilt}
        for hour, angle, paper in zip((12, 13, 14, 15), angles, printed, strict=True):
            row[f"{hour}h"], row[f"{hour}h_paper"] = round(angle, 4), paper
        rows.append(row)
    return rows


def summary_rows(runs: Sequence[Run]) -> Rows:
    """One row per start and estimator: errors of the tilt, then of the normal, degrees."""
    rows = []
    for run in runs:
        outcome = run.outcome
        tilt, angle = asdict(summarise(outcome.tilt_error_deg)), summarise(outcome.normal_error_deg)
        counts = {name: tilt.pop(name) for name in ("slopes", "unsolved")}
        both = {f"tilt_{name}": value for name, value in tilt.items()}
        both |= {f"normal_{name}": getattr(angle, name) for name in ("mae", "p50", "p90", "largest")}
        paper = PAPER_P90_DEG.get(run.begin, float("nan")) if run.method == "contours" else float("nan")
        rows.append({**run.key, **counts, **both, "paper_tilt_p90": paper})
    return rows


def direction_rows(runs: Sequence[Run]) -> Rows:
    """Fig. 10 as numbers: mean absolute tilt error per start, estimator and direction."""
    return [
        {**run.key, "direction_deg": centre, "tilt_mae_deg": error}
        for run in runs
        for centre, error in zip(*run.outcome.by_direction(), strict=True)
    ]


def _of_the_method(options: StudyOptions) -> dict[str, str]:
    """Figs. 5 to 8 and 14: tables at the first minutes of an hour and a half hour of contours."""
    tilts, azimuths = np.arange(0.0, 30.25, 0.5), np.arange(0.0, 361.0)
    try:
        noon = _at_noon(options)
    except NoAnswerError:  # polar winter, or weather without a noon
        return {}
    tables = {name: _table(sky.sun[0], sky.dni_w_m2[0], tilts, azimuths) for name, sky in noon.items()}
    first = next(iter(tables.values()))
    row, column = int(EXAMPLE[0] / 0.5), int(EXAMPLE[1])
    measured = [float(table[row, column]) for table in tables.values()]
    near = [np.abs(table - value) <= 2.0 for table, value in zip(tables.values(), measured, strict=True)]
    scores = np.asarray(np.sum(near, axis=0, dtype=np.float64))
    # a cloud takes a fifth of the beam at the last time; the table assumes a clear sky
    clouded = [*measured[:-1], 0.8 * measured[-1] - 20.0]
    grid = (tilts, azimuths)
    return {
        "figure-05": study_figures.radiation_table(first, *grid),
        "figure-06": study_figures.radiation_table(first, *grid, measured[0]),
        "figure-07": study_figures.contours(tables, *grid, measured, EXAMPLE),
        "figure-08": study_figures.scores(scores, *grid),
        "figure-14": study_figures.contours(tables, *grid, clouded, None),
    }


def _at_noon(options: StudyOptions) -> dict[str, Conditions]:
    noon = replace(options, minutes=1)
    starts = (time(12), time(12, 30), time(13))
    return {f"{start:%H:%M}": conditions(noon, start) for start in starts}


def _table(sun: FloatArray, dni_w_m2: float, tilts: FloatArray, azimuths: FloatArray) -> FloatArray:
    return np.asarray(dni_w_m2 * (normal(tilts[:, np.newaxis], azimuths) @ sun - sun[2]))


def _of_the_field(days: Sequence[FieldDay]) -> dict[str, str]:
    """Figs. 12 and 13, all days in one as in the paper."""
    measured = {name: values for day in days for name, values in day.measured_k.items()}
    modelled = {name: values for day in days for name, values in day.modelled_k.items()}
    errors = {bed: spans for day in days for bed, spans in day.errors.items() if spans}
    drawn = {}
    if measured:
        rmse_k = temperature_rmse_k(measured, modelled)
        drawn["figure-12"] = measured_against_modelled(measured, modelled, rmse_k)
    if errors:
        drawn["figure-13"] = errors_over_local_time(errors, days[0].zone)
    return drawn


def _caption(name: str) -> str:
    kind, which = name[:9], name[10:]
    return f"{CAPTIONS[kind]} ({which})" if which else CAPTIONS[kind]


def _as_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = [column.replace("_", " ") for column in rows[0]]
    return Table(columns, [[_cell(value) for value in row.values()] for row in rows])


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    if value != value:
        return formatting.UNKNOWN
    return "<0.001" if 0 < value < 0.001 else f"{round(value, 3):g}"


def _write_files(folder: Path, texts: dict[str, str], tables: dict[str, Rows], drawn: dict[str, str]) -> None:
    """Write texts by file name, tables as CSV and figures as SVG; raises `StorageError`."""
    texts = texts | {f"{name}.svg": svg for name, svg in drawn.items()}
    with os_errors_as(StorageError, "cannot write", place=folder, fix="give another " + Argument("out")):
        folder.mkdir(parents=True, exist_ok=True)
        for name, rows in tables.items():
            if rows:
                columns = {column: [row[column] for row in rows] for column in rows[0]}
                write_csv(columns, folder / f"{name}.csv")
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
