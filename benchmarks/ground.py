"""The full surface model on measured ground (`fieldkit study --ground`): held-out temperatures, intervals.

Cinder and clay beside a weather station, read from a `shared` folder beside the project where there is one.
"""

from __future__ import annotations

import time
from pathlib import Path

from benchmarks.result import Result
from fieldkit.study.ground import GroundFit, ground_fits

FOLDER = Path(__file__).parents[1].parent / "shared" / "data" / "ground"
MOST_K = {"cinder-2022": 1.5, "clay-2024": 1.3}


def run() -> list[Result]:
    return [result for name in MOST_K for result in _record(name)]


def _record(name: str) -> list[Result]:
    path = FOLDER / f"{name}.csv"
    if not path.exists():
        return [Result(f"{name}, held out", float("nan"), "K", f"<= {MOST_K[name]}", f"skipped: no {path}")]
    began = time.perf_counter()
    fits = ground_fits(path)
    took = time.perf_counter() - began
    held_out = [result for fit in fits for result in _held_out(fit)]
    return [*held_out, Result(f"{name}, both halves", took, "s", "<= 60")]


def _held_out(fit: GroundFit) -> list[Result]:
    score = next(score for score in fit.scores if (score.minutes, score.span) == ("held out", "all"))
    name, most_k = fit.ground.name, MOST_K[fit.ground.name]
    note = f"exchange {fit.exchange}"
    return [
        Result(f"{name}, {fit.fitted} fitted, held-out RMSE", score.rmse_k, "K", f"<= {most_k}", note),
        Result("  inside the 90 % interval", 100.0 * score.coverage, "%", "85 to 95"),
    ]
