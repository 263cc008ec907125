"""Whatever a browser asks for, it reads in its language: no English text or sentence of the catalogue."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.page.sessions import identifier
from fieldkit.phrases import Words, phrases, text_document
from fieldkit.recording.campaign import init_campaign
from tests.harness.field_page import LAPTOP, chromium, opened
from tests.harness.page import Served, served
from tests.harness.waiting import wait_until

ENGLISH = re.compile(r"[A-Za-z]{2,}(?: [A-Za-z]{2,}){2}")
"""Three words in a row; names, units and values come singly."""
ORIGINAL = re.compile(r"（英語：.*?）|（英語）.*$")
"""What a driver or the operating system reports, which is marked as English."""
LINK = {"Accept-Language": "ja,en;q=0.5"}
CORNER = {"kind": "target", "points_px": [[2, 98], [20, 98], [20, 112], [2, 112]]}
CROSSED = {"points_px": [[2, 98], [20, 112], [20, 98], [2, 112]]}
NOBODY = "0" * 16
REQUESTS: list[dict[str, Any]] = [
    {"do": "add_region", "region": {**CORNER, "name": "no spaces"}},
    {"do": "add_region", "region": {**CORNER, "name": "B15"}},
    {"do": "add_region", "region": {**CORNER, **CROSSED, "name": "x", "kind": "reference", "tilt_deg": 5}},
    {"do": "add_region", "region": {**CORNER, "name": "x", "points_px": [[2, 2], [900, 2], [900, 9]]}},
    {"do": "add_region", "region": {**CORNER, "name": "x", "kind": "blackbody"}},
    {"do": "add_region", "region": {**CORNER, "name": "x", "tilt_deg": 120}},
    {"do": "edit_region", "name": "hill", "region": {**CORNER, "name": "hill"}},
    {"do": "remove_region", "name": "hill", "confirm": True},
    {"do": "remove_region", "name": "flat", "confirm": True},
    {"do": "check_region", "region": {**CORNER, "name": "x"}, "shrink": 30},
    {"do": "check_region", "region": {**CORNER, **CROSSED, "name": "x"}},
    {"do": "skyline", "points": [[1, 20], [18, 10]]},
    {"do": "suggest_regions"},
    {"do": "start", "name": "a/b"},
    {"do": "start", "duration": "soon"},
    {"do": "start", "until": "25:99"},
    {"do": "stop", "confirm": True},
    {"do": "mark", "text": "wind"},
    {"do": "mark", "text": "wind", "at": "noon"},
    {"do": "mark", "text": "wind", "at": "2001-01-01"},
    {"do": "mark", "text": "wind", "at": "-1s", "to": "-5s"},
    {"do": "mark", "text": "shade test of hill"},
    {"do": "shutter"},
    {"do": "acknowledge", "alarm": "disk"},
    {"do": "check_session", "session": NOBODY},
    {"do": "marks", "session": NOBODY},
    {"do": "marks"},
    {"do": "nonsense"},
]
STORED = "as the recorder stored it"


def texts(document: Any) -> Iterator[str]:
    """The texts of a message that a browser shows; its values by key are not shown."""
    if isinstance(document, list):
        for part in document:
            yield from texts(part)
    elif isinstance(document, dict):
        yield from (text for name in ("text", "what", "ja") if isinstance(text := document.get(name), str))
        for name in ("data", "issues", "problem", "refusals", "event"):
            yield from texts(document.get(name)) if "key" not in document or name != "data" else ()


def assert_no_english(shown: str) -> None:
    assert not ENGLISH.search(ORIGINAL.sub("", shown)), shown


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = init_campaign(tmp_path_factory.mktemp("languages") / "field", simulated=True).directory
    (folder / "recordings" / "torn.h5").write_bytes(b"not a session")
    with served(folder) as page:
        yield page


@pytest.mark.parametrize("request_", REQUESTS, ids=lambda body: "-".join(map(str, body.values()))[:60])
def test_an_answer_is_in_the_language_of_the_browser(page, request_):
    with page.browser(**LINK) as browser:
        answer = browser.request(**request_)
    shown = list(texts(answer))
    assert shown
    for text in shown:
        assert_no_english(text)


@pytest.mark.parametrize("what", ["estimate_session", "slopes", "marks", "check_session"])
def test_an_error_of_a_file_is_in_the_language_of_the_browser(page, what):
    with page.browser(**LINK) as browser:
        answer = browser.request(do=what, session=identifier(Path("torn.h5")))
    assert_no_english("".join(texts(answer)))


def test_an_error_in_place_of_a_file_or_a_page_is_in_the_language_of_the_browser(page):
    cookie = page.cookie()
    for path in (f"/session/{NOBODY}/report", f"/session/{identifier(Path('torn.h5'))}/picture"):
        answer = page.ask("GET", path, Cookie=cookie, **LINK)
        assert answer.status == 404
        assert_no_english(answer.body.decode())
    for headers in ({"Host": "elsewhere"}, {"Origin": "http://elsewhere"}, {}):
        answer = page.ask("POST", "/key", {"key": "k"}, **LINK, **headers)
        assert answer.status == 403
        assert_no_english(answer.body.decode())


EVENTS = [
    (EventKind.START, {"session": "s"}),
    (EventKind.STOP, {}),
    (EventKind.LOST, {}),
    (EventKind.BACK, {"gap_s": 3.0}),
    (EventKind.GAP, {"lost": 3}),
    (EventKind.SHUTTER, {}),
    (EventKind.FROZEN, {}),
    (EventKind.GARBLED, {"records": 3}),
    (EventKind.CLOUD, {"phase": "begin"}),
    (EventKind.CLOCK_STEP, {"step_ns": 10**9}),
    (EventKind.DISK, {"phase": "begin"}),
    (EventKind.ESTIMATOR, {"late": "begin"}),
    (EventKind.VIEW, {}),
    (EventKind.RECOVERED, {}),
    (EventKind.SLEPT, {"slept_ns": 10**10}),
    (EventKind.MOVED, {"phase": "lost"}),
    (EventKind.OVERRANGE, {"flag": "implausible"}),
    (EventKind.REGION, {"refusals": [text_document(Words("error.duplicate", name="b15"))]}),
    (EventKind.ALARM, {"phase": "raised", "condition": "lost", "subject": "lux"}),
    (EventKind.MODE, {"shows": "hold"}),
]


def test_the_page_shows_no_english(page):
    """With every kind of event and a problem, whose stored sentences are English."""
    hub, link = page.page.hub, f"{page.origin}/#{page.page.keys.new_link('control')}"
    assert {kind for kind, _ in EVENTS} == set(EventKind) - {
        *(EventKind.MARK, EventKind.CLOCK_CHECK, EventKind.IMPORTED)  # a person's own words; never live
    }
    with chromium() as browser:
        watched = opened(browser, link, LAPTOP, locale="ja")
        watched.page.locator("#streams").wait_for(state="attached")
        wait_until(lambda: hub.viewers, "the page is not connected")
        hub.become(problem=SessionError(Words("error.no_frame"), fix=Words("fix.replug")).words)
        for number, (kind, data) in enumerate(EVENTS):
            time_ns = 1_451_674_800_000_000_000 + number
            hub.show(Event(kind, number, time_ns, STORED, "lux", Severity.WARNING, data))
        watched.page.locator("#event-list [data-kind=mode]").first.wait_for()
        shown = watched.page.evaluate("document.body.innerText")
    assert STORED not in shown
    lines = shown.replace(page.page.config.tables.campaign.title, "").splitlines()
    for line in lines:
        assert_no_english(line)
    assert not {text for key, text in phrases().items() if phrases("ja")[key] != text and " " in text} & set(
        lines
    )
