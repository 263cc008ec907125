import re

import pytest
from markupsafe import Markup

from fieldkit.views.html import Figure, Reading, Table, code, environment, render, strong


def block(name: str, *given: object) -> str:
    """What a macro of ``blocks.html`` makes of its arguments."""
    call = f"{{% from 'blocks.html' import {name} %}}{{{{ {name}(*given) }}}}"
    return environment().from_string(call).render(given=given)


def test_text_is_escaped_wherever_it_stands_and_markup_is_not_escaped_twice():
    assert "<li>sand &amp; &lt;stone&gt;</li>" in block("bullets", ["sand & <stone>"])
    assert "<li><strong>a &lt; b</strong></li>" in block("bullets", [strong("a < b")])
    assert code('"<') == "<code>&#34;&lt;</code>"
    assert 'aria-label="a&#34;b &lt;"' in block("figure", Figure("<svg/>", "caption", 'a"b <'))
    made = block("table", Table(("<a>",), [("<b>",)], "<c>"))
    assert all(f"&lt;{letter}&gt;" in made for letter in "abc")
    assert "<b>" not in made


def test_figure_is_an_element_of_the_page_with_words_for_those_who_cannot_see_it():
    made = block("figure", Figure("<?xml?><svg>°</svg>", "caption", "tilt"))
    assert '<svg role="img" aria-label="tilt">°</svg>' in made
    assert "xml" not in made


def test_two_figures_of_a_page_share_no_id():
    drawing = '<svg><defs><path id="a"/></defs><use href="#a" clip-path="url(#a)"/></svg>'
    one, other = (Figure(drawing, "", words) for words in ("tilt", "azimuth"))
    assert one.key != other.key
    assert one.inline.count(f'id="{one.key}-a"') == 1
    assert f'href="#{one.key}-a" clip-path="url(#{one.key}-a)"' in one.inline


def test_values_by_minute_are_reached_without_a_script():
    made = block("figure", Figure("<svg/>", "", "", readings=[Reading(12.5, 0.6, "12:04\nb15 <1°")]))
    assert 'style="--left:12.5%;--width:0.6%"' in made
    assert re.search(r'<input type="radio" name="f[0-9a-f]{8}"><span>12:04\nb15 &lt;1°</span></label>', made)


def test_parts_of_a_figure_can_be_hidden_if_there_are_several():
    made = block("figure", Figure("<svg/>", "", "", parts=["flat", "b15"]))
    assert re.findall(r'class="(part-\d)" checked>(\w+)', made) == [("part-0", "flat"), ("part-1", "b15")]
    for part in ("part-0", "part-1"):
        assert f'figure:has(.{part}:not(:checked)) [id$="{part}"]' in render("page.css")
    assert "checkbox" not in block("figure", Figure("<svg/>", "", "", parts=["flat"]))


@pytest.mark.parametrize(
    ("cells", "aligned"),
    [
        (("3.5", "12.25", "–"), ("3.5_", "12.25", "–")),
        (("5", "0.44"), ("5'__", "0.44")),
        (("-0.2", "+10.0"), ("−0.2", "+10.0")),
        (("4.9 ±1.1", "30.8 ±16.3"), ("_4.9 _±1.1", "30.8 ±16.3")),
        (("+0.6° (+9 W/m²)", "+2.1° (+25 W/m²)"), ("+0.6° _(+9 W/m²)", "+2.1° (+25 W/m²)")),
        (("10 800", "540"), ("10 800", "540")),
        (("12:04", "9:30"), ("12:04", "9:30")),
        (("v1", "12"), ("v1", "12")),
    ],
)
def test_decimal_points_stand_below_each_other(cells, aligned):
    """Here _ is a space as wide as a digit, and ' one as wide as a point."""
    made = [str(row[0]) for row in Table(("",), [(cell,) for cell in cells]).aligned_rows]
    assert made == [cell.replace("_", "\u2007").replace("'", "\u2008") for cell in aligned]


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
