"""HTML pages from the templates in ``templates/``: each page is one file that fetches nothing from outside.

Python prepares the content (`Table`, `Figure`, plain text); the templates hold the markup. Everything that a
template prints is escaped, unless it is `Markup` already.
"""

from __future__ import annotations

import base64
import functools
import itertools
import logging
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from fieldkit.model.errors import ConfigError
from fieldkit.model.installation import install_extra

if TYPE_CHECKING:
    from jinja2 import Environment


NUMBER = re.compile(r"(?<![\w.,])[(±<>]*[+\-−]?\d+(?: \d{3}(?!\d))*(?:\.\d+)?")
AROUND_NUMBERS = re.compile(r"(?:[\s±)°%/–]|given|min|K|W/m²)*")
"""Characters that may stand between the numbers of a cell whose decimal points are aligned."""
FIGURE_SPACE, PUNCTUATION_SPACE = "\u2007", "\u2008"
"""Spaces as wide as a digit and as a point."""
PARTS = 16
"""Parts of a figure that the style sheet can hide, at most."""
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
        """True if any column has a name."""
        return any(self.columns)

    @property
    def numeric(self) -> Sequence[bool]:
        """True for columns that hold one number in each cell, to be aligned at their right."""
        return [_is_numeric(column) and _widest(column) == 1 for column in self._by_column]

    @property
    def aligned_rows(self) -> Sequence[Sequence[object]]:
        """The rows, the decimal points of numbers in a column one below the other."""
        columns = [_align(column) if _is_numeric(column) else column for column in self._by_column]
        return list(zip(*columns, strict=True)) if self.rows else []

    @property
    def _by_column(self) -> Sequence[Sequence[object]]:
        return list(zip(*self.rows, strict=True)) or [()] * len(self.columns)


def _is_numeric(column: Sequence[object]) -> bool:
    """True if cells hold numbers and units; some may hold a dash or a word instead."""
    numbers = [str(cell) for cell in column if NUMBER.search(str(cell))]
    others = [str(cell) for cell in column if str(cell) not in numbers]
    return (
        bool(numbers)
        and all(AROUND_NUMBERS.fullmatch(NUMBER.sub("", cell)) for cell in numbers)
        and not any(character.isdigit() for cell in others for character in cell)
    )


def _widest(column: Sequence[object]) -> int:
    """The largest count of numbers in a cell."""
    return max((len(NUMBER.findall(str(cell))) for cell in column), default=0)


def _align(column: Sequence[object]) -> list[object]:
    """The cells with each number padded to the digits before and after the point that its column needs.

    Before the point only where several numbers share a cell: others stand at the right of the column.
    """
    numbers_by_cell = [[number.partition(".") for number in NUMBER.findall(str(cell))] for cell in column]
    widths = [
        (max(len(whole) for whole, _, _ in numbers), max(len(decimals) for *_, decimals in numbers))
        for numbers in itertools.zip_longest(*numbers_by_cell, fillvalue=("", "", ""))
    ]

    if len(widths) == 1:
        widths = [(0, widths[0][1])]

    def pad_cell(cell: object) -> object:
        if not NUMBER.search(str(cell)):
            return cell
        each = iter(widths)
        return NUMBER.sub(lambda number: _pad(number[0], *next(each)), str(cell))

    return [pad_cell(cell) for cell in column]


def _pad(number: str, before: int, after: int) -> str:
    whole, point, decimals = number.partition(".")
    aligned = FIGURE_SPACE * (before - len(whole)) + whole.replace("-", "−")
    right = (point or PUNCTUATION_SPACE) + decimals + FIGURE_SPACE * (after - len(decimals))
    return aligned + right if after else aligned


@dataclass(frozen=True, slots=True)
class Reading:
    """Values of a figure over time at one minute: a strip of its width in per cent, and the values."""

    left: float
    width: float
    words: str


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure as SVG text with its caption, and `alt` in words; a `wide` one fills the page.

    `readings` are shown under the pointer. `parts` are names of what the reader may hide; the ids of their
    SVG elements end in ``part-0``, ``part-1`` … in the same order.
    """

    svg: str
    caption: str
    alt: str
    wide: bool = False
    readings: Sequence[Reading] = ()
    parts: Sequence[str] = ()

    @property
    def key(self) -> str:
        """A short name, different for each figure of a page."""
        return f"f{zlib.crc32((self.alt + self.svg).encode()):08x}"

    @property
    def inline(self) -> Markup:
        """The drawing as an element of the page, its ids different from those of other figures."""
        element = self.svg[self.svg.index("<svg") :]
        unique = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{self.key}-", element)
        opening = Markup('<svg role="img" aria-label="{}"').format(self.alt)
        return Markup(unique.replace("<svg", opening, 1))  # matplotlib escapes its texts


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
    from jinja2 import Environment, PackageLoader, StrictUndefined  # every recording imports this file

    environment = Environment(
        loader=PackageLoader("fieldkit.views"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.globals["hideable_parts"] = PARTS
    environment.globals["install_extra"] = install_extra
    environment.tests["short"] = lambda cell: len(escape(cell)) < SHORT
    environment.filters["number"] = lambda value: f"{value:g}"
    return environment


def require_weasyprint() -> None:
    """Raises `ConfigError` where WeasyPrint is not installed, before hours are spent on the page."""
    if find_spec("weasyprint") is None:
        raise ConfigError(
            "a report as PDF needs WeasyPrint",
            fix=f"{install_extra('pdf')}, or print the HTML from a browser",
        )


def write_pdf(page: Path, pdf: Path) -> None:
    """Print an HTML page on A4; raises `OSError` if the file cannot be written."""
    from weasyprint import HTML

    # it warns about screen rules that do not apply to print
    logging.getLogger("weasyprint").setLevel(logging.ERROR)
    HTML(filename=str(page)).write_pdf(str(pdf))
