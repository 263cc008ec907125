"""A page of HTML in one file: text is escaped once, here, and nothing is fetched from outside.

Small on purpose: headings, paragraphs, tables and figures. Readable on a phone, on a desk and
on A4 paper.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence


class Html(str):
    """Text that is markup already and must not be escaped again."""

    __slots__ = ()


def text(content: object) -> Html:
    """`content` as it should be read; `Html` passes unchanged."""
    return content if isinstance(content, Html) else Html(html.escape(str(content)))


def element(tag: str, *contents: object, **attributes: str) -> Html:
    """One element; ``class_`` stands for ``class``, ``aria_label`` for ``aria-label``."""
    given = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{html.escape(value)}"' for name, value in attributes.items()
    )
    return Html(f"<{tag}{given}>{''.join(map(text, contents))}</{tag}>")


def section(heading: str, *contents: object) -> Html:
    """A part of the page under its heading; parts that are empty are left out."""
    return element("section", element("h2", heading), *contents)


def paragraph(*contents: object, class_: str = "") -> Html:
    """One paragraph."""
    return element("p", *contents, class_=class_) if class_ else element("p", *contents)


def bullets(items: Iterable[object]) -> Html:
    """A list of points."""
    return element("ul", *(element("li", item) for item in items))


def table(columns: Sequence[str], rows: Iterable[Sequence[object]], *, caption: object = "") -> Html:
    """A table that scrolls sideways by itself where the screen is narrow, with its caption under it.

    Without column headings the first cell of each row is the row's heading.
    """
    named = any(columns)
    head = element("thead", element("tr", *(element("th", name, scope="col") for name in columns)))
    body = element("tbody", *(_row(row, named=named) for row in rows))
    scroller = element("div", element("table", head if named else "", body), class_="wide")
    return Html(scroller + (paragraph(caption, class_="caption") if caption else ""))


def _row(cells: Sequence[object], *, named: bool) -> Html:
    if named:
        return element("tr", *map(_cell, cells))
    return element("tr", element("th", cells[0], scope="row"), *map(_cell, cells[1:]))


def _cell(content: object) -> Html:
    shown = text(content)
    is_short = len(shown) < 24  # numbers and names; words may wrap
    return element("td", shown, class_="n") if is_short else element("td", shown)


def figure(svg: str, caption: object, alt: str) -> Html:
    """A picture that comes as SVG text, with a caption, and `alt` for those who cannot see it."""
    data = base64.b64encode(svg.encode()).decode()
    return element(
        "figure",
        Html(f'<img alt="{html.escape(alt)}" src="data:image/svg+xml;base64,{data}">'),
        element("figcaption", caption),
    )


def page(title: str, *contents: object) -> str:
    """The whole document."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(map(text, contents))
        + "\n</main>\n</body>\n</html>\n"
    )


STYLE = """
:root { color-scheme: light; --ink: #1a1a1a; --quiet: #555; --rule: #c8c8c8; --accent: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
main { max-width: 76rem; margin: 0 auto; padding: 1rem 1.25rem 3rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: .5rem 0 .25rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; padding-top: .5rem; border-top: 2px solid var(--ink); }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
p, ul { max-width: 46rem; margin: .5rem 0; }
ul { padding-left: 1.3rem; }
.facts { color: var(--quiet); }
.verdict { font-size: 1.15rem; border-left: .35rem solid var(--accent); padding: .4rem 0 .4rem .8rem; }
.verdict.doubt { border-color: #d55e00; }
.figures { display: grid; gap: .5rem 1.5rem;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr)); }
figure { margin: .8rem 0; break-inside: avoid; }
figure img, figure svg { display: block; width: 100%; height: auto; }
figure.picture { max-width: 42rem; }
figcaption, .caption { color: var(--quiet); font-size: .9rem; max-width: 46rem; padding: .3rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .95rem; margin: .5rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .9rem .3rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--rule); }
th { font-weight: 600; white-space: nowrap; }
thead th { border-bottom: 2px solid var(--ink); }
td.n { white-space: nowrap; }
code, pre { font: .85rem/1.45 ui-monospace, "DejaVu Sans Mono", monospace; }
pre { overflow-x: auto; background: #f5f5f5; padding: .8rem; }
code { overflow-wrap: anywhere; }
summary { cursor: pointer; margin: .8rem 0; }
@media (max-width: 30rem) {
  body { font-size: 15px; } main { padding: .5rem .9rem 2rem; } h1 { font-size: 1.4rem; }
}
@media print {
  @page { size: A4; margin: 15mm; }
  body { font-size: 10pt; } main { max-width: none; padding: 0; } p, ul { max-width: none; }
  h2 { break-after: avoid; margin-top: 1.4rem; } tr { break-inside: avoid; }
  .figures { display: block; }
  .figures figure { display: inline-block; width: 48.5%; vertical-align: top; margin-right: 1%; }
  figure.picture { width: 60%; }
  .wide { overflow: visible; } table { font-size: 8.5pt; } th, td { padding-right: .6rem; }
  pre { white-space: pre-wrap; }
  details.printed::details-content { content-visibility: visible; }
}
"""
