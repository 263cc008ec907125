"""Output of the study of measured ground: scores and parameters, series, figures, one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fieldkit.model.confidence import CONFIDENCE, percent
from fieldkit.results.json_document import to_json
from fieldkit.study.ground import GroundFit
from fieldkit.study.output import Rows, write_files
from fieldkit.views import plotting
from fieldkit.views.html import Figure, Table, render
from fieldkit.views.study_figures import ground_temperatures


def document(fits: Sequence[GroundFit]) -> dict[str, Any]:
    """Scores and parameters of every fit, for ``--json`` and ``ground.json``."""
    return {
        "ground": [
            {
                "record": fit.ground.name,
                "fitted": fit.fitted,
                "exchange": fit.exchange,
                "parameters": [asdict(parameter) for parameter in fit.parameters],
                "scores": [asdict(score) for score in fit.scores],
            }
            for fit in fits
        ]
    }


def score_rows(fits: Sequence[GroundFit]) -> list[list[str]]:
    """One row of words per fit, half and span: the table for people."""
    return [
        [
            fit.ground.name,
            fit.fitted,
            score.minutes,
            score.span,
            str(score.count),
            f"{score.rmse_k:.2f}",
            f"{score.bias_k:+.2f}",
            f"{score.coverage:.0%}",
        ]
        for fit in fits
        for score in fit.scores
    ]


SURE = percent(CONFIDENCE)
SCORE_COLUMNS = ("record", "fitted", "minutes", "span", "n", "RMSE K", "bias K", f"inside {SURE}")


def parameter_rows(fits: Sequence[GroundFit]) -> list[list[str]]:
    """One row of words per fit and parameter."""
    return [
        [
            fit.ground.name,
            fit.fitted,
            parameter.name.replace("_", " "),
            f"{parameter.prior:.3g}",
            f"{parameter.value:.3g}",
            f"{parameter.low:.3g} to {parameter.high:.3g}",
            parameter.unit or "–",
            f"{parameter.share_of_prior:.0%}",
        ]
        for fit in fits
        for parameter in fit.parameters
    ]


PARAMETER_COLUMNS = ("record", "fitted", "parameter", "prior", "value", SURE, "unit", "sd / prior sd")


def write(folder: Path, fits: Sequence[GroundFit]) -> None:
    """Write ground.json, ground.html, and of each fit its minutes and a figure; raises `StorageError`."""
    drawn = {_name(fit): _figure(fit) for fit in fits} if plotting.available() else {}
    page = render(
        "ground.html",
        confidence=SURE,
        scores=Table(SCORE_COLUMNS, score_rows(fits)),
        parameters=Table(PARAMETER_COLUMNS, parameter_rows(fits)),
        drawn=[
            Figure(svg, _caption(fit), _caption(fit)) for fit, svg in zip(fits, drawn.values(), strict=False)
        ],
    )
    texts = {"ground.json": to_json(document(fits)), "ground.html": page}
    write_files(folder, texts, {_name(fit): _minutes(fit) for fit in fits}, drawn)


def _name(fit: GroundFit) -> str:
    return f"ground-{fit.ground.name}-{fit.fitted.replace(' ', '-')}"


def _caption(fit: GroundFit) -> str:
    return f"{fit.ground.name}, {fit.fitted} fitted: temperatures with {SURE} prediction interval, residuals"


def _figure(fit: GroundFit) -> str:
    return ground_temperatures(fit.ground.surface_k, fit.modelled_k, fit.half_width_k, fit.chosen)


def _minutes(fit: GroundFit) -> Rows:
    columns = (fit.chosen, fit.ground.surface_k, fit.modelled_k, fit.half_width_k)
    return [
        {
            "minute": minute,
            "fitted": int(fitted),
            "measured_k": round(measured, 3),
            "modelled_k": round(modelled, 3),
            "half_width_k": round(half_width, 3),
        }
        for minute, (fitted, measured, modelled, half_width) in enumerate(
            zip(*(column.tolist() for column in columns), strict=True)
        )
    ]
