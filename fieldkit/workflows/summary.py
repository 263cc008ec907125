"""What a sweep keeps of each run: one row for each bed, and errors where its tilt is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.estimation.answers import WORKED_OUT
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeState
from fieldkit.workflows.batch import Outcome
from fieldkit.workflows.grid import Grid
from fieldkit.workflows.ranking import Ranking, ranked


class Summary:
    """Rows of a sweep, in the order of sessions, sets and beds however the runs came in.

    `cached` counts the runs that were known before.
    """

    def __init__(self, grid: Grid, names: Mapping[Path, str]) -> None:
        self._grid, self._names = grid, dict(names)
        self._beds: dict[tuple[int, int], list[dict[str, Any]]] = {}
        self.cached = 0
        self._places = {path: place for place, path in enumerate(self._names)}

    def __bool__(self) -> bool:
        return bool(self._beds)

    def add(self, outcome: Outcome) -> None:
        """Take the estimates of one run."""
        run, estimates = outcome.run, outcome.estimates
        self.cached += outcome.cached
        targets = [region for region in estimates.regions if region.kind is RegionKind.TARGET]
        place = self._places[run.source.path]
        self._beds[place, run.number] = [_bed(region, estimates.of_region(region)) for region in targets]

    def columns(self) -> dict[str, list[Any]]:
        """The tidy table; keys of parameters as in ``fieldkit.toml``, angles in degrees."""
        names = list(self._names.values())
        rows = [
            {"session": names[place], "set": number, **self._values(number), **bed}
            for (place, number), beds in sorted(self._beds.items())
            for bed in beds
        ]
        return {column: [row[column] for row in rows] for column in (rows[0] if rows else ())}

    def ranking(self) -> Ranking | None:
        """The sets by their errors; None where no bed of known tilt was answered."""
        shape = len(self._grid.sets), len(self._names)
        error, worst = np.full((2, *shape), np.nan)
        answers, uncertain = np.zeros((2, *shape), np.int64)
        for (place, number), beds in self._beds.items():
            known = [bed for bed in beds if np.isfinite(bed["median_abs_error_deg"])]
            answers[number, place] = sum(bed["answered"] for bed in known)
            uncertain[number, place] = sum(bed["uncertain"] for bed in known)
            if known:
                error[number, place] = np.mean([bed["median_abs_error_deg"] for bed in known])
                worst[number, place] = max(bed["worst_abs_error_deg"] for bed in known)
        return ranked(
            error, worst, answers, uncertain, self._grid.sets, self._grid.varied, tuple(self._names.values())
        )

    def _values(self, number: int) -> dict[str, Any]:
        """The parameters of a set: numbers where all values of the key are, else as written."""
        written = (setting.split("=", 1)[1] for setting in self._grid.sets[number])
        return {
            parameter.key: float(value) if all(map(_is_number, parameter.values)) else value
            for parameter, value in zip(self._grid.parameters, written, strict=True)
        }


def _bed(region: Region, rows: NDArray[np.void]) -> dict[str, Any]:
    answered = rows[np.isin(rows["state"], [int(state) for state in WORKED_OUT])]
    tilt, error = answered["tilt_deg"], np.abs(answered["tilt_deg"] - region.tilt_deg)
    known = error.size > 0 and np.isfinite(region.tilt_deg)
    return {
        "region": region.name,
        "true_tilt_deg": region.tilt_deg,
        "minutes": int(rows.size),
        "answered": int(answered.size),
        "uncertain": int(np.count_nonzero(rows["state"] == SlopeState.UNCERTAIN)),
        "median_tilt_deg": float(np.median(tilt)) if tilt.size else float("nan"),
        "mean_error_deg": float(np.mean(tilt) - region.tilt_deg) if known else float("nan"),
        "mean_abs_error_deg": float(np.mean(error)) if known else float("nan"),
        "median_abs_error_deg": float(np.median(error)) if known else float("nan"),
        "worst_abs_error_deg": float(np.max(error)) if known else float("nan"),
    }


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
