"""The emissivities that were found from a session, in its report: value, validity, fit, pairs and budget."""

from __future__ import annotations

from collections.abc import Iterator

from fieldkit.calibration.calibration_record import validity
from fieldkit.calibration.uncertainty import largest
from fieldkit.views.html import data_uri
from fieldkit.views.report.series import ReportData


def emissivities(data: ReportData) -> Iterator[tuple[str, str, str]]:
    """Name, words and address of the figure ("" without one) of each emissivity found from the session."""
    for record, file in data.calibrations:
        if record.kind == "emissivity":
            found = f"{record.value:.3f} ± {record.expanded:.3f} (k=2) by {record.method}"
            limit = f"the largest contribution is {largest(record.budget).name}" if record.budget else ""
            drawn = file.with_suffix(".svg")
            figure = data_uri("image/svg+xml", drawn.read_bytes()) if drawn.is_file() else ""
            yield record.name, f"{found}; {limit}. Holds for {validity(record)}. Record: {file.name}.", figure
