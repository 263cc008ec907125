"""HTML pages from the templates in ``templates/``: each page is one file that fetches nothing from outside.

Python prepares the content (`Table`, `Figure`, plain text); the templates hold the markup. Everything that a
template prints is escaped, unless it is `Markup` already.
"""

from __future__ import annotations

import base64
import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from fieldkit.views.formatting import UNKNOWN

NUMBER = re.compile(r"[-+−±>]? ?\d[\d.,\s]*[%°]?( ?± ?\d[\d.]*°?)?")
SHORT = 24
"""Cells with fewer characters (numbers, names) are kept on one line; longer text may wrap."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table with its caption; without column names the first cell of each row is the row's heading."""

    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    caption: str = ""

    @property
    def has_headings(self) -> bool:
        """Whether any column has a name."""
        return any(self.columns)

    @property
    def numeric(self) -> Sequence[bool]:
        """Which columns hold numbers, to be aligned at their right."""
        return [
            any(map(_is_number, column)) and all(map(_is_number_or_absent, column))
            for column in zip(*self.rows, strict=True)
        ] or [False] * len(self.columns)


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure as SVG text with its caption, and `alt` in words; a `wide` one fills the page."""

    svg: str
    caption: str
    alt: str
    wide: bool = False

    @property
    def data_uri(self) -> str:
        """The figure as the address of an image."""
        return data_uri("image/svg+xml", self.svg.encode())


def _is_number(cell: object) -> bool:
    return NUMBER.fullmatch(str(cell)) is not None


def _is_number_or_absent(cell: object) -> bool:
    return _is_number(cell) or str(cell) in ("", UNKNOWN)


def strong(text: str) -> Markup:
    """`text` in bold."""
    return Markup("<strong>{}</strong>").format(text)


def code(text: str) -> Markup:
    """`text` as something to type or compare letter by letter."""
    return Markup("<code>{}</code>").format(text)


def bar(share: float) -> Markup:
    """A share in [0, 1] as a small bar with its percentage."""
    return Markup('<span class="bar"><span style="width:{0}%"></span></span>{0}%').format(round(share * 100))


def data_uri(media_type: str, content: bytes) -> str:
    """An address that holds its content, so that a page needs no second file."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"


def table_html(content: Table) -> str:
    """A table alone, for the notebook that shows an object."""
    return str(environment().get_template("blocks.html").make_module().table(content))  # type: ignore[attr-defined]


def render(template: str, **content: object) -> str:
    """The page that a template makes of `content`; the arguments are the template's variables."""
    return environment().get_template(template).render(content)


@functools.cache
def environment() -> Environment:
    """The templates: escaped by default, and a variable that is missing is an error."""
    made = Environment(
        loader=PackageLoader("fieldkit.views"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.tests["short"] = lambda cell: len(escape(cell)) < SHORT
    made.filters["number"] = lambda value: f"{value:g}"
    return made
