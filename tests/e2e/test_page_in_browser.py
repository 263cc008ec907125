"""The field page in Chromium: the journey by touch, all of it by keyboard, and what it refuses."""

from __future__ import annotations

import json
import re
import time
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fieldkit.config import load_config
from fieldkit.model.site import Region, RegionKind
from fieldkit.page.phrases import issue_document
from fieldkit.phrases import Words, phrases, text_document
from fieldkit.sessions.reader import open_session
from fieldkit.simulation.facets import FRAME_SHAPE
from fieldkit.simulation.scene import BEDS
from tests.harness import field_page_journey as journey
from tests.harness.field_page import (
    LAPTOP,
    PHONE,
    PHONE_ON_ITS_SIDE,
    SMALLEST,
    Watched,
    opened,
    served,
)
from tests.harness.waiting import wait_until

pytestmark = pytest.mark.usefixtures("closed_afterwards")
BACK_WITHIN_S = 2.0
FIRST_SLOPE_WITHIN_S = 90.0
TARGET_SIZES = """[...document.querySelectorAll(
        "button, input:not([type=radio], [type=checkbox]), .choice label")]
    .filter((one) => one.checkVisibility())
    .map((one) => [one.id || one.textContent, one.getBoundingClientRect()])
    .map(([name, box]) => [name, Math.round(box.width), Math.round(box.height)])"""
SIZES = (SMALLEST, PHONE, (390, 844), PHONE_ON_ITS_SIDE, LAPTOP)
CUT_PLACEHOLDERS = """[...document.querySelectorAll("[placeholder]")]
    .filter((input) => input.checkVisibility() && !input.value)
    .filter((input) => {
        const pen = document.createElement("canvas").getContext("2d"), style = getComputedStyle(input);
        pen.font = style.font;
        const room = input.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
        return pen.measureText(input.placeholder).width > room;
    })
    .map((input) => input.name)"""
CORNERS = """[...document.querySelectorAll(".draft .hit")]
    .map((one) => [+one.getAttribute("cx"), +one.getAttribute("cy")])"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    with served(journey.empty_campaign(tmp_path_factory.mktemp("page") / "sandslope")) as page:
        yield page


def test_the_whole_journey_by_touch(browser, tmp_path):
    campaign = journey.empty_campaign(tmp_path / "sandslope")
    with served(campaign, *journey.SETTINGS) as page:
        began = time.monotonic()
        watched = opened(browser, page.link())
        watched.wait_for_picture()
        assert "#" not in watched.page.url  # the key has left the address bar
        watched.page.evaluate(journey.COUNT_STEPS)
        journey.draw(watched, "flat", journey.FLAT, journey.unseen)
        journey.draw(watched, "b15", journey.B15, journey.unseen, tilt="15")
        written = (campaign / "fieldkit.toml").read_text(encoding="utf-8")
        assert 'name = "b15"' in written
        assert written.startswith("#")  # its comments are still there
        with journey.quick(campaign):
            journey.record(watched, journey.unseen)
        wall_s, user_s = time.monotonic() - began, journey.user_s(watched)
        journey.mark(watched, journey.unseen)
        journey.be_warned(watched, journey.unseen)
        _zoom_the_plot(watched)
        bar = watched.page.locator("#time-bar").evaluate("(bar) => bar.value / bar.max")
        assert 0.0 < bar <= 1.0
        journey.stop(watched, journey.unseen)
        assert watched.page.locator("#answers a", has_text="Report").is_visible()
        assert "two-beds" in journey.report(watched, journey.unseen)
        assert "tilt" in journey.estimate_anew(watched, journey.unseen)
        watched.page.locator("#stage:not(.stale)").wait_for()  # live again
        assert watched.foreign == []
        assert watched.errors == []
    (session,) = (campaign / "recordings").glob("*two-beds.h5")
    recorded_s = _until_a_slope_s(session) / journey.SPEED
    print(f"to a slope: user {user_s:.0f} s, recording {recorded_s:.0f} s; this machine {wall_s:.0f} s")
    assert user_s + recorded_s < FIRST_SLOPE_WITHIN_S


def _until_a_slope_s(path: Path) -> float:
    """Seconds of a session until its first slope was known: the minute's end, and two seconds."""
    with open_session(path) as session:
        known = [one.time_ns for one in session.estimates() if np.isfinite(one.tilt_deg)]
        return (min(known) - session.start_ns) / 1e9 + 62.0


def _zoom_the_plot(watched: Watched) -> None:
    """The wheel shortens the time shown, and Home shows all of it again."""
    chart = watched.page.locator("#plot")
    chart.scroll_into_view_if_needed()

    def lines() -> list[int]:
        counts: list[int] = chart.evaluate(
            "(plot) => [...plot.querySelectorAll('polyline')].map((line) => line.points.numberOfItems)"
        )
        return counts

    wait_until(lambda: max(lines(), default=0) > 5, "no minutes are plotted")
    before = max(lines())
    assert chart.locator("polygon").count() > 0  # the regions of the tilts
    wait_until(lambda: chart.locator(".marks").count() > 0, "the mark is not plotted")
    box = chart.bounding_box()
    assert box is not None
    watched.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 50)
    watched.page.mouse.wheel(0, -300)
    wait_until(lambda: max(lines()) < before, "the wheel does not zoom")
    assert chart.locator(".cursor path").count() == 1
    first = watched.page.locator("#plot-time").inner_text()
    for _ in range(3):
        chart.press("ArrowLeft")
    assert watched.page.locator("#plot-time").inner_text() != first
    assert re.search(r"b15 .*\d °C", watched.page.locator("#plot-names").inner_text())
    chart.press("Home")
    wait_until(lambda: max(lines()) >= before, "Home does not show all")


def test_palette_theme_and_language_are_chosen_and_kept_on_the_device(browser, page):
    """Hot is black: the legend begins white."""
    watched = opened(browser, page.link(), locale="en", color_scheme="light")
    watched.wait_for_picture()
    watched.page.locator("#conditions-list", has_text=phrases()["clock.simulated"]).wait_for()  # and no lag
    first = "[...document.getElementById('legend').getContext('2d').getImageData(0, 0, 1, 1).data]"
    assert watched.page.evaluate(first) == [0, 0, 4, 255]  # inferno's first colour (matplotlib)
    for choice, option in (("palette", "black hot"), ("theme", "dark"), ("language", "ja")):
        watched.page.locator(f"#{choice}").select_option(option)
    for _ in range(2):
        watched.page.locator("html[lang=ja][data-theme=dark]").wait_for()
        assert watched.page.evaluate(first) == [255, 255, 255, 255]
        watched.page.reload()
        watched.wait_for_picture()
    background = watched.page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert max(map(int, re.findall(r"\d+", background))) < 64
    assert watched.errors == []


def test_times_after_the_first_day_of_a_recording_have_their_date(browser, page):
    watched = opened(browser, page.link())
    watched.wait_for_picture()
    browser_code = resources.files("fieldkit.page") / "browser"
    times = (browser_code / "dom.js").read_text(encoding="utf-8")
    clock = re.search(
        r"^function clockTime.*?^}", (browser_code / "status.js").read_text("utf-8"), re.M | re.S
    )
    assert clock is not None
    noon = "Date.UTC(2026, 2, 7, 12)"
    code = f"{times} const phrase = () => 'en-GB', status = {{ state: {{ started_ms: {noon} }} }}; {clock[0]}"
    shown = f"(() => {{ {code} return [1, 24].map((hours) => clockTime({noon} + hours * 3600e3)); }})()"
    assert watched.page.evaluate(shown) == ["13:00:00", "8 Mar 12:00:00"]


@pytest.mark.parametrize(
    ("language", "theme"),
    [
        ("en", "light"),
        ("ja", "dark"),
        *(pytest.param(*look, marks=pytest.mark.slow) for look in (("en", "dark"), ("ja", "light"))),
    ],
)
def test_axe_finds_nothing_and_everything_fits(browser, page, language, theme):
    """As the browser prefers it, at every width."""
    watched = opened(browser, page.link(), locale=language, color_scheme=theme)
    watched.wait_for_picture()
    root = watched.page.locator("html")
    assert root.get_attribute("lang") == language
    assert root.get_attribute("data-theme") == {"light": "sunlight", "dark": "dark"}[theme]
    _is_sound(watched, *SIZES)
    watched.page.locator("#draw").click()
    watched.drag(*journey.B15)
    watched.page.locator("#verdict-text", has_text="px").wait_for()
    _is_sound(watched, *SIZES)
    watched.page.locator("#skyline-choice").click()
    _is_sound(watched, PHONE)
    watched.page.locator("#cancel-drawing").click()
    for button in ("#start", "#list-sessions"):
        watched.page.locator(button).click()
        _is_sound(watched, SMALLEST, LAPTOP)
        watched.page.keyboard.press("Escape")
    assert watched.errors == []


def _is_sound(watched: Watched, *sizes: tuple[int, int]) -> None:
    for width, height in sizes:
        watched.page.set_viewport_size({"width": width, "height": height})
        if (width, height) in (sizes[0], sizes[-1]):
            assert watched.violations() == [], width
        assert watched.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), width
        assert watched.page.evaluate(CUT_PLACEHOLDERS) == [], width


EVENTS: list[tuple[str, str, dict[str, Any], str]] = [
    ("estimator", "warning", {"shaded": "b15", "phase": "begin"}, "estimator.shaded.begin"),
    ("estimator", "warning", {"late": "end"}, "estimator.late.end"),
    ("estimator", "error", {}, "estimator.error"),
    ("moved", "warning", {"phase": "lost"}, "moved.lost"),
    ("moved", "warning", {"phase": "lost", "region": "b15"}, "moved.region.lost"),
    ("cloud", "info", {"phase": "end", "request": "7"}, "cloud.end"),
    ("gap", "warning", {"lost": 3}, "gap.lost"),
    ("gap", "warning", {"lost": 1}, "gap.lost"),
    ("gap", "warning", {}, "gap"),
    ("lost", "error", {}, "lost.error"),
    ("back", "info", {"gap_s": 12.0}, "back"),
    ("overrange", "warning", {"flag": "saturated"}, "overrange.flag.saturated"),
    ("alarm", "error", {"phase": "raised", "condition": "lost", "subject": "camera"}, "alarm.raised"),
    ("mark", "info", {"corrects": 2, "takes_back": 1}, "mark.takes_back"),
    ("of-a-newer-version", "info", {}, ""),
]


def test_an_event_has_the_most_particular_text_for_its_kind_and_data(browser, page):
    watched = opened(browser, page.link(), LAPTOP)
    folder = resources.files("fieldkit.page") / "browser"
    code = "".join((folder / name).read_text("utf-8") for name in ("phrases.js", "dom.js"))
    code = code.replace("{{languages}}", "{}").replace("{{texts}}", json.dumps(phrases()))
    for kind, severity, data, key in EVENTS:
        event = {"kind": kind, "severity": severity, "data": data, "stream": "lux", "text": "stored"}
        event["time_ms"] = 1e12
        shown = watched.page.evaluate(f"(() => {{ {code} return eventText({json.dumps(event)}); }})()")
        words = {
            **data,
            "stream": "lux",
            "gap_s": "12 s",
            "mark": "stored",
            "alarm": "camera does not respond",
        }
        assert shown == (Words(f"event.{key}", **words) if key else "stored"), kind
    happened = Words("issue.event", time="at noon", event="stored {3}", happened=event)
    issues = [
        issue_document({"what": "clock", **text_document(Words("issue.missing", count=3, last=9))}, "en"),
        issue_document({"what": "gap lux", **text_document(happened)}, "en"),
        issue_document({"text": "of a {newer} version"}, "en"),
    ]
    event["kind"] = "gap"
    shown = watched.page.evaluate(f"(() => {{ {code} return {json.dumps(issues)}.map(issueText); }})()")
    gap = phrases()["event.gap"].format_map(words)
    missing = Words("issue.missing", count=3, last=9)
    assert shown == [f"clock: {missing}", f"at noon {gap}", "of a {newer} version"]


def test_every_target_is_large_enough_for_a_thumb(browser, page):
    watched = opened(browser, page.link())
    watched.wait_for_picture()
    watched.page.locator("#draw").tap()
    watched.drag(*journey.B15)
    for name, width, height in watched.page.evaluate(TARGET_SIZES):
        assert min(width, height) >= 48, (name, width, height)
    hits = "[...document.querySelectorAll('#overlay .hit')].map((one) => one.getBoundingClientRect().width)"
    assert [round(width) for width in watched.page.evaluate(hits)] == [44] * 4


def test_corners_are_tapped_moved_added_and_undone(browser, page):
    watched = opened(browser, page.link())
    watched.wait_for_picture()
    watched.page.locator("#draw").tap()
    for corner in ((30, 30), (70, 30), (70, 60)):
        watched.tap(*corner)
    watched.tap(30, 30)  # the first one again: closed
    watched.page.locator("#verdict-text", has_text="px").wait_for()
    assert _corners(watched) == [[30, 30], [70, 30], [70, 60]]
    watched.drag((70, 60), (70, 80))
    assert _corners(watched)[2] == [70, 80]
    watched.tap(50, 30)  # an edge
    assert len(_corners(watched)) == 4
    watched.page.locator("#undo").tap()
    watched.page.locator("#undo").tap()
    assert _corners(watched) == [[30, 30], [70, 30], [70, 60]]
    watched.drag((60, 40), (65, 45))  # the inside: all of it
    assert _corners(watched) == [[35, 35], [75, 35], [75, 65]]
    assert watched.errors == []


def test_suggested_regions_are_added_by_one_tap_each(browser, tmp_path):
    """A region lies inside the bed that the simulated field has there."""
    campaign = journey.empty_campaign(tmp_path / "sandslope")
    with served(campaign) as page:
        watched = opened(browser, page.link(), SMALLEST)
        watched.wait_for_picture()
        watched.page.locator("#suggest").tap()
        buttons = watched.page.locator("#suggestion-list button")
        buttons.first.wait_for()
        outlines = watched.page.locator("#overlay .suggested")
        assert outlines.count() == buttons.count() >= 3
        assert watched.violations() == []
        assert watched.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        buttons.first.tap()
        watched.page.locator("#cards .card").first.wait_for()
        watched.page.locator("#dismiss-suggestions").tap()
        assert outlines.count() == 0
        assert watched.errors == []
    (region,) = load_config(campaign / "fieldkit.toml").regions
    beds = [Region(bed.name, RegionKind.TARGET, bed.points_px).mask(FRAME_SHAPE) for bed in BEDS]
    inside = region.mask(FRAME_SHAPE)
    assert any(bed[inside].all() for bed in beds)


POSE = """[camera.pose]
crs = "EPSG:32613"
east_m = 418860.0
north_m = 4172900.0
height_m = 2318.0
yaw_deg = 180.0
pitch_deg = 0.0
hfov_deg = 90.0
range_m = 60.0
ground_m = 2300.0
"""


def test_a_skyline_is_tapped_and_becomes_the_horizon(browser, tmp_path):
    """80 px of focal length, level and to the south: 40 px up in the middle are the arc tangent of a half."""
    campaign = journey.empty_campaign(tmp_path / "sandslope")
    file = campaign / "fieldkit.toml"
    with served(campaign) as page:
        watched = opened(browser, page.link())
        watched.wait_for_picture()
        watched.page.locator("#draw").tap()
        watched.page.locator("#skyline-choice").tap()
        for number, corner in enumerate(((40, 60), (80, 19), (140, 40), (120, 60))):
            watched.tap(*corner)
            watched.page.locator(".draft .hit").nth(number).wait_for(state="attached")  # the layout may move
        watched.page.locator("#undo").tap()
        assert _corners(watched) == [[40, 60], [80, 19], [140, 40]]
        watched.page.locator("#save-region").tap()
        watched.page.locator("#drawing-error", has_text="needs the pose of the camera").wait_for()
        file.write_text(file.read_text(encoding="utf-8") + POSE, encoding="utf-8")
    with served(campaign) as page:
        watched = opened(browser, page.link(), LAPTOP)
        watched.wait_for_picture()
        watched.page.locator("#draw").focus()
        watched.page.keyboard.press("Enter")
        watched.page.locator("[name=kind][value=skyline]").press(" ")
        stage = watched.page.locator("#stage")
        for moves in (["ArrowUp", "Shift+ArrowUp"], ["Shift+ArrowRight"]):
            for move in moves:
                stage.press(move)
            stage.press("Enter")
        corners = _corners(watched)
        watched.page.locator("#save-region").press("Enter")
        watched.page.locator("#answers [data-key='done.skyline']").wait_for()
    pairs = load_config(file).estimator_settings().horizon
    x, y = corners[0]
    up = np.degrees(np.arctan((59.5 - y) / np.hypot(80.0, x - 79.5)))
    assert pairs[1] == pytest.approx((180.0 + np.degrees(np.arctan((x - 79.5) / 80.0)), up), abs=0.05)
    assert len(pairs) == len(corners) + 2


def _corners(watched: Watched) -> list[list[int]]:
    found: list[list[int]] = watched.page.evaluate(CORNERS)
    return found


def test_the_keyboard_alone_draws_starts_marks_and_stops(browser, tmp_path):
    with served(journey.empty_campaign(tmp_path / "sandslope")) as page:
        watched = opened(browser, page.link(), LAPTOP)
        watched.wait_for_picture()
        keys = watched.page.keyboard
        watched.tab_to("#draw")
        keys.press("Enter")
        for moves in (
            (("ArrowLeft", 5), ("ArrowUp", 2)),
            (("ArrowRight", 3),),
            (("ArrowDown", 2),),
            (("ArrowLeft", 3),),
        ):
            for key, times in moves:
                for _ in range(times):
                    keys.press(f"Shift+{key}")
            keys.press("Enter")
        assert len(_corners(watched)) == 4
        watched.tab_to("#close-outline")
        keys.press("Enter")
        watched.tab_to("[data-corner='0']", backwards=True)
        before = _corners(watched)[0]
        keys.press("ArrowLeft")
        assert _corners(watched)[0] == [before[0] - 1, before[1]]
        watched.tab_to("#drawing [name=name]")
        keys.press("Control+a")
        keys.type("flat")
        keys.press("Enter")
        watched.page.locator("#card-flat").wait_for()
        watched.tab_to("#start")
        keys.press("Enter")
        keys.type("by-keyboard")
        keys.press("Enter")
        watched.said("by-keyboard")
        watched.page.locator("#event-list li[data-kind=start]").wait_for()
        watched.tab_to("#mark")
        keys.press("Enter")
        watched.tab_to("#mark-dialog [name=text]")
        keys.type("wind picks up")
        keys.press("Enter")
        watched.page.locator("#event-list li", has_text="wind picks up").wait_for()
        watched.tab_to("#stop")
        keys.press("Enter")
        watched.tab_to("#confirm-yes")
        keys.press("Enter")
        wait_until(lambda: "preview" in watched.state, "it does not stop")
        assert watched.errors == []


def test_a_killed_server_comes_back_by_itself(browser, page):
    watched = opened(browser, page.link())
    watched.wait_for_picture()
    page.kill()
    watched.page.locator("#connection", has_text="Connection lost").wait_for()
    watched.page.locator("#stage.stale").wait_for()
    assert "old" in watched.page.locator("#stale").inner_text()
    page.start()
    began = time.monotonic()
    watched.page.locator("#connection").wait_for(state="hidden")
    assert time.monotonic() - began <= BACK_WITHIN_S
    watched.page.locator("#stage:not(.stale)").wait_for()


def test_the_view_link_only_looks(browser, page):
    watched = opened(browser, page.link("view"))
    watched.wait_for_picture()
    visible = watched.page.locator("#actions button:visible, .control:visible").all()
    assert visible == []


def test_a_browser_without_a_key_is_told_what_to_do(browser, page):
    watched = opened(browser, page.address)
    watched.page.locator("#connection[data-key='refused.no_key']").wait_for()
    link = page.link()
    opened(browser, link).wait_for_picture()
    again = opened(browser, link)
    again.page.locator("#connection[data-key='refused.used']").wait_for()
