"""Sessions estimated with every combination of parameters: the runs of a sweep, and what they gave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldkit.model.errors import ConfigError, FieldkitError
from fieldkit.workflows.batch import Run, run_of
from fieldkit.workflows.grid import Grid
from fieldkit.workflows.ranking import Ranking
from fieldkit.workflows.sources import Source

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Sweep:
    """What a sweep found: a table with a row for each session, set of parameters and bed, and the ranking.

    `ranking` is None where no bed of known tilt was answered. `failures` has the sessions that could not
    be estimated, and why.
    """

    grid: Grid
    columns: Mapping[str, Sequence[Any]]
    ranking: Ranking | None
    failures: Mapping[Path, FieldkitError]

    @property
    def best(self) -> dict[str, str]:
        """The best set by the key of each parameter; empty without a ranking."""
        if self.ranking is None:
            return {}
        return dict(setting.split("=", 1) for setting in self.grid.sets[self.ranking.best])

    def to_frame(self) -> pd.DataFrame:
        """The table as a pandas frame; needs ``fieldkit[lab]``."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns))


def names_of(sources: Sequence[Source]) -> dict[Path, str]:
    """How the tables call each session: by its file's name, or its path where two have the same name."""
    stems = [source.path.stem for source in sources]
    return {
        source.path: stem if stems.count(stem) == 1 else str(source.path)
        for source, stem in zip(sources, stems, strict=True)
    }


def runs_of(sources: Sequence[Source], grid: Grid) -> list[Run]:
    """Every session with every set; raises `ConfigError`, also for a key of no effect."""
    runs = [run_of(source, one, number) for source in sources for number, one in enumerate(grid.sets)]
    for parameter in grid.varied if sources else ():
        tried = [run_of(sources[0], [f"{parameter.key}={value}"]) for value in parameter.values[:2]]
        if tried[0].key == tried[1].key:
            tables = "surface, air, irradiance, estimator, slab, site"
            raise ConfigError(f"{parameter.key} does not enter an estimate", fix=f"keys that do: of {tables}")
    return runs
