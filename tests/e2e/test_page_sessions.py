"""Recorded sessions on the page: marks edited and taken back, small images, slopes beside each other, °F."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import fieldkit
from fieldkit.model.samples import Event, EventKind
from fieldkit.page.pictures import THUMBNAIL_COLS
from fieldkit.page.sessions import identifier
from fieldkit.results.describe import recorded_slopes
from fieldkit.sessions.writer import SessionWriter
from fieldkit.views.formatting import local_time
from tests.harness import field_page
from tests.harness.field_page import LAPTOP, PHONE, PHONE_ON_ITS_SIDE, SMALLEST, Watched, opened
from tests.harness.page import Answer, Served, served
from tests.harness.recording import CountedClock, fill, header
from tests.harness.waiting import PATIENCE_S, wait_until

FITS = "document.documentElement.scrollWidth <= window.innerWidth"
COLOURS = (
    "(canvas) => new Set(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data).size"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, recorded):
    """A campaign with the same session twice, and one with the marks 2 "wind" and 3 "cloud"."""
    folder = tmp_path_factory.mktemp("page") / "sandslope"
    session = recorded(folder)
    shutil.copy(session, session.with_name("20160102T190001Z-again.h5"))
    clock = CountedClock()
    writer = SessionWriter(session.with_name("marked.h5"), header((24, 32)), clock)
    fill(writer, 10, clock)
    for text in ("wind", "cloud"):
        now = clock.mono_ns()
        writer.put(Event(EventKind.MARK, now, clock.to_utc_ns(now), text, data={"label": text}))
    writer.close()
    return folder


@pytest.fixture(scope="module")
def page(folder):
    with served(folder) as page:
        yield page


def test_marks_are_edited_taken_back_and_count_again_while_the_session_keeps_them(page, folder, tmp_path):
    path = folder / "recordings/marked.h5"
    with fieldkit.open_session(path) as session:
        made = [event.text for event in session.events(recorded=True)]
        at = local_time(session.start_ns, session.site).isoformat()
    this = {"session": identifier(path)}
    with page.browser("view") as looking:
        cloud = looking.request(do="marks", **this)["data"][2]
        assert (cloud["kind"], cloud["text"]) == ("cloud", "cloud")
        assert not looking.request(do="take_back", mark=2, **this)["ok"]
    with page.browser() as browser:
        assert browser.request(do="take_back", mark=2, **this)["ok"]
        done = browser.request(do="edit_mark", mark=3, text="haze", kind="sky", at=at, **this)
        assert done["data"] == {"mark": 3, "text": "haze"}
        _, first, second = browser.request(do="marks", **this)["data"]
        assert (first["text"], first["counts"]) == ("wind", False)
        assert (second["kind"], second["text"], second["counts"]) == ("sky", "haze", True)
        with fieldkit.open_session(path) as session:
            marks = {number: mark.text for number, mark in session.marks().items()}
            assert marks == {1: "wolke über b05", 3: "haze"}
            assert [event.text for event in session.events(recorded=True)][: len(made)] == made
        assert browser.request(do="edit_mark", mark=2, **this)["ok"]
        assert [one["counts"] for one in browser.request(do="marks", **this)["data"]] == [True] * 3
        assert browser.request(do="take_back", mark=7, **this)["text"].startswith("7: ")
        assert not browser.request(do="marks")["ok"]


def test_small_images_and_slopes_are_those_of_the_session(page, folder):
    path = folder / "recordings/20160102T190001Z-again.h5"
    small = page.ask("GET", f"/session/{identifier(path)}/thumbnail", Cookie=page.cookie())
    size = int.from_bytes(small.body[:2], "little")
    head = json.loads(small.body[2 : 2 + size])
    assert (head["cols"], head["rows"]) == (THUMBNAIL_COLS, 120)
    assert len(small.body) < 8000
    assert page.ask("GET", f"/session/{identifier(path)}/thumbnail", Cookie=page.cookie("view")).status == 403
    with page.browser("view") as browser, fieldkit.open_session(path) as session:
        shown = browser.request(do="slopes", session=identifier(path))["data"]
        recorded = recorded_slopes(session)
        assert [one["region"] for one in shown] == [one.region for one in recorded]
        tilts = [float(re.match(r"[\d.]+", one["tilt"])[0]) for one in shown]  # type: ignore[index]
        assert tilts == pytest.approx([one.tilt_deg for one in recorded], abs=0.5)


@pytest.fixture
def phone(browser, page):
    """The list of sessions on a phone."""
    watched = opened(browser, f"{page.origin}/#{page.page.keys.new_link('control')}", PHONE)
    watched.page.locator("#start").wait_for()  # connected
    watched.page.locator("#list-sessions").tap()
    watched.page.locator("#session-list li").nth(2).wait_for()
    yield watched
    assert (watched.foreign, watched.errors) == ([], [])
    watched.page.context.close()


def at_every_size(watched: Watched) -> None:
    for width, height in (SMALLEST, PHONE, PHONE_ON_ITS_SIDE, LAPTOP):
        watched.page.set_viewport_size({"width": width, "height": height})
        assert watched.page.evaluate(FITS), width
        if field_page.AXE in field_page.os.environ:
            assert watched.violations() == [], width


def test_sessions_are_compared_and_marks_edited_and_taken_back_by_touch(phone):
    """Each has its image, in the colours of the palette, and its row of slopes."""
    page = phone.page
    small = page.locator("#session-list .thumbnail")
    wait_until(lambda: small.first.evaluate(COLOURS) > 10, "no small image")
    for choice in page.locator("#session-list .check").all()[:2]:
        choice.tap()
    at_every_size(phone)
    page.locator("#compare", has_text="Compare 2 sessions").click()
    page.locator("#compare-slopes tr").first.wait_for()
    assert page.locator("#compare-head canvas").count() == 2
    assert re.search(r"Tilt \d", page.locator("#compare-slopes").inner_text())
    at_every_size(phone)
    page.locator("#compare-dialog .cancel").click()
    page.locator("#compare-dialog").wait_for(state="hidden")
    item = page.locator("#session-list li", has_text="three beds")
    item.get_by_role("button", name="Marks").tap()
    first = page.locator("#mark-list li").first
    first.get_by_role("button", name="Take back").tap()
    page.locator("#mark-list .gone").wait_for()
    at_every_size(phone)
    first.get_by_role("button", name="Restore").tap()
    page.locator("#mark-list .gone").wait_for(state="detached")
    first.get_by_role("button", name="Edit").click()
    at_every_size(phone)
    page.locator("#mark-dialog [name=text]").fill("a gust")
    page.get_by_role("button", name="Save mark").click()
    page.locator("#mark-list li", has_text="a gust").wait_for()
    page.locator("#marks-dialog .cancel").click()


def test_the_keyboard_alone_searches_compares_corrects_and_chooses(browser, page):
    watched = opened(browser, f"{page.origin}/#{page.page.keys.new_link('control')}", LAPTOP)
    watched.page.locator("#start").wait_for()  # connected
    keys, shown = watched.page.keyboard, watched.page.locator("#session-list li:visible")
    watched.tab_to("#list-sessions")
    keys.press("Enter")
    shown.nth(2).wait_for()
    watched.tab_to("#session-search input")
    keys.type("no such session")
    watched.page.locator("#no-match:not(:empty)").wait_for()
    keys.press("Control+a")
    keys.type("three beds")
    assert shown.count() == 1
    keys.press("Control+a")
    keys.press("Delete")
    _compare_two(watched)
    _correct_a_mark(watched)
    for choice, stored in (("palette", "ironbow"), ("unit", "°F")):
        watched.tab_to(f"#{choice}")
        keys.press("ArrowDown")
        assert watched.page.evaluate(f"localStorage.getItem('{choice}')") == stored
    assert (watched.foreign, watched.errors) == ([], [])
    watched.page.context.close()


def _compare_two(watched: Watched) -> None:
    keys = watched.page.keyboard
    for place in (1, 2):
        watched.tab_to(f"#session-list li:nth-child({place}) [type=checkbox]")
        keys.press("Space")
    keys.press("Tab")  # it is beside the last choice
    assert watched.page.evaluate("document.activeElement.id") == "compare"
    keys.press("Enter")
    watched.page.locator("#compare-slopes tr").first.wait_for()
    watched.tab_to("#compare-dialog .wide-table")  # which scrolls by arrow keys
    keys.press("Escape")
    watched.page.locator("#compare-dialog").wait_for(state="hidden")


def _correct_a_mark(watched: Watched) -> None:
    keys, marks = watched.page.keyboard, watched.page.locator("#mark-list li")
    item = watched.page.locator("#session-list li", has_text="three beds")
    heading = item.locator("h3").get_attribute("id")
    watched.tab_to(f"#session-list button[aria-describedby={heading}]:nth-last-of-type(2)", backwards=True)
    keys.press("Enter")
    watched.tab_to("#mark-list li:last-child button:last-child")
    keys.press("Enter")
    watched.page.locator("#mark-list .gone button:focus").wait_for()  # Restore, where Take back was
    keys.press("Enter")
    watched.page.locator("#mark-list li:last-child:not(.gone) button:focus").wait_for()  # Edit
    keys.press("Enter")
    watched.tab_to("#mark-dialog [name=text]")
    keys.press("Control+a")
    keys.type("haze")
    keys.press("Enter")
    marks.filter(has_text="haze").wait_for()
    keys.press("Escape")
    watched.page.locator("#marks-dialog").wait_for(state="hidden")


def _made(page: Served, path: Path, kind: str) -> Answer:
    """What is made of a session, once it is."""
    url, cookie = f"/session/{identifier(path)}/{kind}", page.cookie()
    assert page.ask("GET", url, Cookie=page.cookie("view")).status == 403
    wait_until(
        lambda: page.ask("GET", url, Cookie=cookie).status != 202, f"no {kind}", PATIENCE_S, every_s=0.5
    )
    answer = page.ask("GET", url, Cookie=cookie)
    assert answer.status == 200, answer
    assert answer.headers["content-disposition"].startswith("attachment")
    return answer


def test_a_time_lapse_is_made_of_the_frames_of_a_session(page, folder, tmp_path):
    film = tmp_path / "film.mp4"
    film.write_bytes(_made(page, folder / "recordings/marked.h5", "timelapse").body)
    assert cv2.VideoCapture(str(film)).get(cv2.CAP_PROP_FRAME_COUNT) == 10


@pytest.mark.slow
def test_one_image_is_made_of_a_day(page, folder):
    image = _made(page, folder / "recordings/20160102T190001Z-again.h5", "image").body
    assert cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR).shape == (1080, 1920, 3)
