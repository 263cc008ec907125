"""Result of every calibration: a record that is not yet saved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldkit.calibration.calibration_record import CalibrationRecord, Kind, Source, expiry, save
from fieldkit.calibration.ranges import require_name
from fieldkit.calibration.uncertainty import Contribution, combined_uncertainty
from fieldkit.disk import sha256
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Action
from fieldkit.model.version import __version__
from fieldkit.sessions.reader import SessionReader

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Calibration:
    """A calibration that is not yet saved.

    `record` holds value, uncertainty and error budget; `summary` states them in a line or two.
    `used_by` is the line of ``fieldkit.toml`` that uses the record, `folder` where the campaign keeps its
    records.

    Examples
    --------
    >>> kappa = fieldkit.calibrate.surface(session, settings={"estimator.model": "paper"})
    >>> kappa.used_by
    'estimator.scale = "@beds"'
    >>> kappa.to_frame().columns.tolist()
    ['name', 'uncertainty', 'unit', 'kind', 'effect']
    >>> kappa.save().name
    '20160101T192001Z-beds.toml'
    """

    record: CalibrationRecord
    summary: str
    used_by: str
    folder: Path

    def save(self, folder: Path | None = None) -> Path:
        """Write the record file into the campaign's folder or another one; its path.

        Raises `StorageError` if the folder has another record of the same name and date.
        """
        return save(self.record, folder or self.folder)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.summary}>"

    def to_frame(self) -> pd.DataFrame:
        """The error budget, one row per contribution."""
        import pandas as pd

        return pd.DataFrame(self.record.budget)


def make_record(
    kind: Kind,
    name: str,
    value: float,
    unit: str,
    budget: tuple[Contribution, ...],
    sessions: Sequence[SessionReader] = (),
    *,
    date: datetime | None = None,
    files: Sequence[Path] = (),
    **parts: Any,
) -> CalibrationRecord:
    """The record of a calibration; the end of its last session is its `date`, the budget its uncertainty.

    Its sources are the sessions and `files`; `parts` are further fields. Raises as `stamp`.
    """
    paths = (*(session.path for session in sessions), *files)
    record = CalibrationRecord(
        kind,
        name,
        date or datetime.fromtimestamp(sessions[-1].end_ns // 10**9, UTC),
        value,
        combined_uncertainty(budget),
        unit,
        budget=budget,
        sources=tuple(Source(path.name, sha256(path)) for path in paths),
        **parts,
    )
    return stamp(record)


def stamp(record: CalibrationRecord) -> CalibrationRecord:
    """The record with its date of expiry and the version of this software.

    Raises `ConfigError` for a name that no file can have, `CalibrationError` for a result that is no number.
    """
    require_name(record.name)
    if not (math.isfinite(record.value) and math.isfinite(record.standard_uncertainty)):
        raise CalibrationError(
            f"would be {record.value:g} ± {record.standard_uncertainty:g}: not determined",
            place=record.name,
            fix="check the standard uncertainties given, and the data: " + Action.CHECK(),
        )
    version = f"fieldkit {__version__}"
    return replace(record, software=version, expires=expiry(record.kind, record.date))
