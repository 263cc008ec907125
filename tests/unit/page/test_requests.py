"""Whatever a browser sends becomes a request or a refusal, never anything else."""

import json
from contextlib import suppress
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldkit.page import requests
from fieldkit.page.requests import BadRequestError, parse
from fieldkit.phrases import text_document

REGION = {"name": "b15", "kind": "target", "points_px": [[1, 2], [30, 2.5], [30, 40]]}
GOOD: list[dict[str, Any]] = [
    {"do": "picture", "mode": "jpeg"},
    {"do": "value", "x": 3, "y": 4.5},
    {"do": "check_region", "region": REGION, "shrink": 2},
    {"do": "sessions"},
    {"do": "check_session", "session": "0123456789abcdef"},
    {"do": "estimate_session", "session": "0123456789abcdef"},
    {"do": "start", "name": "day", "duration": "3h"},
    {"do": "stop", "confirm": True},
    {"do": "mark", "text": "a cloud", "kind": "cloud", "at": "-30s", "to": None},
    {"do": "shutter"},
    {"do": "acknowledge", "alarm": "no-frame camera"},
    {"do": "add_region", "region": {**REGION, "tilt_deg": 15, "azimuth_deg": None}},
    {"do": "edit_region", "name": "b15", "region": REGION},
    {"do": "remove_region", "name": "b15", "confirm": True},
    {"do": "skyline", "points": [[1, 20], [30, 2.5]]},
    {"do": "suggest_regions", "session": None},
    {"do": "slopes", "session": "20160101T190001Z-noon"},
    {"do": "marks", "session": None},
    {"do": "take_back", "mark": 2},
    {"do": "edit_mark", "mark": 1, "text": "b15 shaded", "kind": "shade", "at": "12:14"},
]
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
)


def is_parsed_or_refused(text: str) -> None:
    with suppress(BadRequestError):
        assert isinstance(parse(text), get_args(requests.Request))


@pytest.mark.parametrize("body", GOOD, ids=lambda body: str(body["do"]))
def test_every_request_is_read(body):
    found = parse(json.dumps({**body, "id": 7}))
    assert found.id == 7
    assert found.do == body["do"]


def test_every_kind_of_request_is_tried_here():
    assert {body["do"] for body in GOOD} == {
        get_args(kind.model_fields["do"].annotation)[0] for kind in get_args(requests.Request)
    }


@pytest.mark.parametrize(
    "body",
    [
        {"do": "stop"},
        {"do": "stop", "confirm": False},
        {"do": "remove_region", "name": "b15"},
        {"do": "start", "duration": "3h", "until": "17:00"},
        {"do": "mark", "text": ""},
        {"do": "mark", "text": "x" * 2001},
        {"do": "picture", "mode": "gif"},
        {"do": "sessions", "path": "/etc/passwd"},
        {"do": "add_region", "region": {**REGION, "points_px": [[1, 2], [3, 4]]}},
        {"do": "add_region", "region": {**REGION, "points_px": [[1, 2], [3, 4], [5, float("inf")]]}},
        {"do": "add_region", "region": {**REGION, "points_px": [[1, 2, 3]] * 4}},
        {"do": "take_back", "mark": 0},
        {"do": "edit_mark", "mark": "first"},
        {"do": "slopes"},
        {"do": "format"},
        {"mode": "jpeg"},
    ],
)
def test_what_is_incomplete_or_unknown_is_refused_with_its_number(body):
    with pytest.raises(BadRequestError) as error:
        parse(json.dumps({**body, "id": 3}))
    assert error.value.id == 3


@pytest.mark.parametrize(
    ("body", "key"),
    [
        ({"do": "start", "until": ""}, "empty"),
        ({"do": "start", "duration": ""}, "empty"),
        ({"do": "mark", "text": "a cloud", "at": ""}, "empty"),
        ({"do": "mark", "text": "x" * 2001}, "too_long"),
        ({"do": "mark", "text": "\x00"}, "not_text"),
        ({"do": "check_region", "region": {**REGION, "tilt_deg": 91}}, "less_than_equal"),
        ({"do": "check_region", "region": {**REGION, "emissivity": 0}}, "greater_than_equal"),
    ],
)
def test_what_a_person_typed_is_refused_with_what_to_do_about_it(body, key):
    with pytest.raises(BadRequestError) as error:
        parse(json.dumps(body))
    assert text_document(error.value.words)["key"] == f"refused.{key}"


@pytest.mark.parametrize("odd", ["a\x00b", "a\ud800b", "\udc00", "\x1b[2J"])
@pytest.mark.parametrize(
    "body",
    [
        {"do": "start", "name": "x"},
        {"do": "mark", "text": "x"},
        {"do": "mark", "text": "wind", "kind": "x"},
        {"do": "acknowledge", "alarm": "x"},
    ],
)
def test_text_that_is_not_text_is_refused_as_such(body, odd):
    with pytest.raises(BadRequestError) as error:
        parse(json.dumps(body).replace('"x"', json.dumps(odd)))
    assert text_document(error.value.words)["key"] == "refused.not_text"


@pytest.mark.parametrize(
    "text",
    [
        '{"do": "mark", "text": "\\ud800", "id": 3}',
        '{"id": 3, "do": "mark", "text": "\\udfff\\ud800"}',
        '{"id":3, "do"',
    ],
)
def test_what_is_not_json_is_refused_with_its_number(text):
    with pytest.raises(BadRequestError) as error:
        parse(text)
    assert error.value.id == 3


def test_text_may_have_lines_and_any_letters():
    for text in ("two\nlines", "a\tb", "砂", "\U0001f321", "\ufffd", "\xa0"):
        assert parse(json.dumps({"do": "mark", "text": text})).text == text


@given(st.text())
def test_any_text(text):
    is_parsed_or_refused(text)


@given(json_values)
def test_any_json(value):
    is_parsed_or_refused(json.dumps(value))


@given(st.sampled_from(GOOD), st.data())
def test_requests_with_a_part_replaced(body, data):
    key = data.draw(st.sampled_from([*body, "id"]))
    is_parsed_or_refused(json.dumps({**body, key: data.draw(json_values)}))


@given(st.sampled_from(GOOD), st.integers(0, 200), st.binary(max_size=3))
def test_requests_with_bytes_replaced(body, at, garbage):
    text = json.dumps(body).encode()
    is_parsed_or_refused((text[:at] + garbage + text[at + len(garbage) :]).decode("latin-1"))


@pytest.mark.parametrize("text", ["[" * 5000, '{"a":' * 3000, "x" * 20_000, '{"id": ' + "9" * 5000 + "}"])
def test_deep_long_and_large_ones(text):
    with pytest.raises(BadRequestError):
        parse(text)
