"""The whole study: simulated runs, the field days, and what is written of both.

>>> paper_study(StudyOptions(slopes=400)).to_frame()          # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldkit.study import output
from fieldkit.study.field_days import FieldDay, field_days
from fieldkit.study.runs import Run, StudyOptions, run_all, sensitivity

if TYPE_CHECKING:
    import pandas as pd

PAPER = StudyOptions()


@dataclass(frozen=True)
class PaperStudy:
    """Result of a study: a run for each start and estimator, the field days, and the sensitivity rows."""

    options: StudyOptions
    runs: Sequence[Run]
    days: Sequence[FieldDay]
    sensitivity: output.Rows

    @cached_property
    def tables(self) -> dict[str, output.Rows]:
        """All tables by name, each a list of rows."""
        return output.tables(self.runs, self.sensitivity, self.days)

    @property
    def document(self) -> dict[str, Any]:
        """The options and the short tables, as in ``study.json``."""
        return output.document(self.options, self.tables)

    def to_frame(self) -> pd.DataFrame:
        """Errors by start and estimator, degrees, as a pandas frame; needs ``fieldkit[lab]``."""
        import pandas as pd

        return pd.DataFrame(self.tables["errors"])

    def write(self, folder: str | Path) -> None:
        """Write tables, figures and a page with all of them; raises `StorageError`."""
        drawn = output.figures(self.options, self.runs, self.days)
        output.write(Path(folder), self.document, self.tables, drawn)


def paper_study(
    options: StudyOptions = PAPER,
    *,
    sessions: Sequence[Path] = (),
    with_sensitivity: bool = False,
    on_stage: Callable[[str], None] = lambda _: None,
) -> PaperStudy:
    """Reproduce sections 2–5 of the paper.

    Parameters
    ----------
    options
        What is simulated and how it is estimated; the paper's by default.
    sessions
        Recordings for the field figures, instead of the paper's days under a simulated sky.
    with_sensitivity
        Repeat the runs for several irradiances and tolerances, which the paper does not state.
    on_stage
        Receives the name of each stage as it begins.

    Raises
    ------
    NoAnswerError
        If the sun is down, or no weather was measured, during a window.
    """
    runs = run_all(options)
    on_stage("field")
    days = field_days(sessions)
    on_stage("tables and figures")
    return PaperStudy(options, runs, days, sensitivity(options) if with_sensitivity else [])
