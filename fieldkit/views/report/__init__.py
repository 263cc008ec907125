"""The report of a session: one HTML file that holds everything and needs nothing from outside.

`write_report` puts it together, `write_campaign_report` that of several sessions. `series` lines
the minutes up, `budget` and `verdict` work out numbers from them; `canvas`, `figures` and
`paper_figures` draw; `answers`, `causes` and `records` are its sections.
"""

from fieldkit.views.report.campaign import Part, write_campaign_report
from fieldkit.views.report.write import write_report

__all__ = ["Part", "write_campaign_report", "write_report"]
