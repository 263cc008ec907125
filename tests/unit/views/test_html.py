from __future__ import annotations

import base64
import re

from fieldkit.views.html import Html, bullets, element, figure, page, paragraph, section, table


def test_text_is_escaped_and_markup_is_not_escaped_twice():
    assert paragraph("sand & <stone>") == "<p>sand &amp; &lt;stone&gt;</p>"
    assert paragraph(element("em", "a < b")) == "<p><em>a &lt; b</em></p>"


def test_attributes_are_escaped():
    assert element("p", "x", class_='a"b', aria_label="<") == '<p class="a&quot;b" aria-label="&lt;">x</p>'


def test_table_cells_are_escaped_in_every_place():
    made = table(("<a>",), [("<b>",)], caption="<c>")
    assert all(f"&lt;{letter}&gt;" in made for letter in "abc")


def test_a_table_without_headings_has_its_headings_in_the_rows():
    made = table(("", ""), [("state", "sealed")])
    assert '<th scope="row">state</th>' in made
    assert "<thead>" not in made


def test_figure_travels_inside_the_page_with_words_for_those_who_cannot_see_it():
    made = figure("<svg>°</svg>", "caption", 'tilt "b15"')
    data = re.search(r'src="data:image/svg\+xml;base64,([^"]+)"', made).group(1)
    assert base64.b64decode(data).decode() == "<svg>°</svg>"
    assert 'alt="tilt &quot;b15&quot;"' in made


def test_page_is_a_whole_document():
    made = page("a < b", section("heading", bullets(["one", Html("<b>two</b>")])))
    assert made.startswith("<!DOCTYPE html>")
    assert "<title>a &lt; b</title>" in made
    assert "<h2>heading</h2><ul><li>one</li><li><b>two</b></li></ul>" in made
