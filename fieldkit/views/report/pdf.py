"""A report's page as PDF, by WeasyPrint from the extra ``pdf``; the page says itself how it is printed."""

from __future__ import annotations

import logging
from importlib.util import find_spec
from pathlib import Path

from fieldkit.model.errors import ConfigError


def refuse_without_printer() -> None:
    """Raises `ConfigError` where WeasyPrint is not installed, before hours are spent on the page."""
    if find_spec("weasyprint") is None:
        raise ConfigError(
            "a report as PDF needs WeasyPrint",
            fix="pip install 'fieldkit[pdf]', or print the HTML from a browser",
        )


def write_pdf(page: Path, pdf: Path) -> None:
    """Print an HTML page on A4; raises `OSError` if the file cannot be written."""
    from weasyprint import HTML

    # it complains of rules of the screen that mean nothing on paper
    logging.getLogger("weasyprint").setLevel(logging.ERROR)
    HTML(filename=str(page)).write_pdf(str(pdf))
