"""The report of a session, or of several together, as one HTML file that needs nothing from outside.

`write_report` gathers the `ReportData`, and each section turns a part of it into HTML.
"""

from fieldkit.views.report.campaign_report import Part, write_campaign_report
from fieldkit.views.report.series import ReportData
from fieldkit.views.report.session_report import write_report

__all__ = ["Part", "ReportData", "write_campaign_report", "write_report"]
