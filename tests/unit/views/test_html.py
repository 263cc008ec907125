from __future__ import annotations

import base64
import re

import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from fieldkit.views.html import Figure, Table, code, environment, render, strong


def block(name: str, *given: object) -> str:
    """What a macro of ``blocks.html`` makes of its arguments."""
    call = f"{{% from 'blocks.html' import {name} %}}{{{{ {name}(*given) }}}}"
    return environment().from_string(call).render(given=given)


def test_text_is_escaped_and_markup_is_not_escaped_twice():
    assert "<li>sand &amp; &lt;stone&gt;</li>" in block("bullets", ["sand & <stone>"])
    assert "<li><strong>a &lt; b</strong></li>" in block("bullets", [strong("a < b")])
    assert code('"<') == "<code>&#34;&lt;</code>"


def test_attributes_are_escaped():
    assert 'alt="a&#34;b &lt;"' in block("figure", Figure("<svg/>", "caption", 'a"b <'))


def test_table_cells_are_escaped_in_every_place():
    made = block("table", Table(("<a>",), [("<b>",)], "<c>"))
    assert all(f"&lt;{letter}&gt;" in made for letter in "abc")
    assert "<b>" not in made


def test_a_table_without_headings_has_its_headings_in_the_rows():
    made = block("table", Table(("", ""), [("state", "sealed")]))
    assert '<th scope="row">state</th>' in made
    assert "<thead>" not in made


def test_short_cells_do_not_wrap():
    made = block("table", Table(("a", "b"), [("12.3", "a sentence that may go over several lines")]))
    assert '<td class="n">12.3</td><td>a sentence' in made


def test_figure_travels_inside_the_page_with_words_for_those_who_cannot_see_it():
    made = block("figure", Figure("<svg>°</svg>", "caption", "tilt"))
    data = re.search(r'src="data:image/svg\+xml;base64,([^"]+)"', made).group(1)
    assert base64.b64decode(data).decode() == "<svg>°</svg>"
    assert 'alt="tilt"' in made


def test_page_is_a_whole_document():
    made = render(
        "study.html", conditions="a < b", tables=[("<h>", Table(("a",), [(Markup("<b>2</b>"),)]))], drawn=[]
    )
    assert made.startswith("<!DOCTYPE html>")
    assert made.endswith("</html>\n")
    assert "<title>Simulation study</title>" in made
    assert '<p class="facts">a &lt; b</p>' in made
    assert "<h2>&lt;h&gt;</h2>" in made
    assert "<b>2</b>" in made


def test_a_missing_variable_is_an_error_not_a_gap_in_the_page():
    with pytest.raises(UndefinedError):
        render("study.html", conditions="")
