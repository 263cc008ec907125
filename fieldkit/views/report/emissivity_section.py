"""The emissivities of a session in its report: those that its slopes use, and those found from it."""

from __future__ import annotations

from collections.abc import Mapping

from fieldkit.calibration.calibration_record import CalibrationRecord, validity
from fieldkit.calibration.uncertainty import largest
from fieldkit.views.html import Table, data_uri
from fieldkit.views.report.series import ReportData


def emissivity_section(data: ReportData) -> Mapping[str, object] | None:
    """The section as the template shows it: records, cautions, figures of those found; None without any."""
    active = [(key, record) for key, record in data.active.items() if record.kind == "emissivity"]
    measured = [(record, file) for record, file in data.calibrations if record.kind == "emissivity"]
    rows = [_row(record, f"used as {key}") for key, record in active]
    rows += [_row(record, f"found from this session: {file.name}") for record, file in measured]
    drawn = [file.with_suffix(".svg") for _, file in measured]
    columns = ("holds for", "emissivity (k=2)", "method", "largest contribution", "")
    figures = [data_uri("image/svg+xml", figure.read_bytes()) for figure in drawn if figure.is_file()]
    return {"records": Table(columns, rows), "cautions": data.cautions, "figures": figures} if rows else None


def _row(record: CalibrationRecord, use: str) -> list[object]:
    value = f"{record.value:.3f} ± {record.expanded:.3f}"
    limit = largest(record.budget).name if record.budget else ""
    return [validity(record), value, record.method, limit, use]
