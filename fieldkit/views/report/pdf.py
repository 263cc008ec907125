"""A report as PDF, by WeasyPrint from the extra ``pdf``; the style sheet has its own rules for print."""

from __future__ import annotations

import logging
from importlib.util import find_spec
from pathlib import Path

from fieldkit.model.errors import ConfigError


def require_weasyprint() -> None:
    """Raises `ConfigError` where WeasyPrint is not installed, before hours are spent on the page."""
    if find_spec("weasyprint") is None:
        raise ConfigError(
            "a report as PDF needs WeasyPrint",
            fix="pip install 'fieldkit[pdf]', or print the HTML from a browser",
        )


def write_pdf(page: Path, pdf: Path) -> None:
    """Print an HTML page on A4; raises `OSError` if the file cannot be written."""
    from weasyprint import HTML

    # it warns about screen rules that do not apply to print
    logging.getLogger("weasyprint").setLevel(logging.ERROR)
    HTML(filename=str(page)).write_pdf(str(pdf))
