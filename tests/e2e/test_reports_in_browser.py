"""Reports, plan and study in Chromium: first screen, phone, dark style, print, values without a script."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from fieldkit.page.server import REPORT_POLICY
from tests.harness.command_line import succeed
from tests.harness.field_page import opened
from tests.harness.seldom import SET_SELDOM

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DESK, PHONE = (1200, 800), (390, 800)
pytestmark = pytest.mark.usefixtures("closed_afterwards")
PAGES = ("session", "weather", "campaign", "plan", "study")
AT_ONCE = ("-q", "--set", "simulation.speed=max", *SET_SELDOM)
POINTS_OF_LINES = """[...document.querySelectorAll('.drawing g[id*="-axes_"]')].map((axes) =>
    [...axes.querySelectorAll(":scope > g > path")].map((path) => path.getAttribute("d").split("L").length))
    .map((lengths) => Math.max(0, ...lengths))"""
SHOWN = """[...document.querySelectorAll(".readings span")].filter(
    (one) => getComputedStyle(one).clipPath === "none").map((one) => one.textContent)"""
HIDDEN_PARTS = """[...document.querySelectorAll("figure:has(.parts) g[id*='-part-']")].filter(
    (one) => getComputedStyle(one).display === "none").map((one) => one.id.replace(/.*(part-)/, "$1"))"""

BREAKS = """([selector, property]) => [...new Set([...document.querySelectorAll(selector)].map(
    (element) => getComputedStyle(element)[property]))]"""


@pytest.fixture(scope="module")
def pages(browser, recorded, tmp_path_factory):
    """One page of each kind, of simulated sessions; asked for the browser first, which may be missing."""
    folder = tmp_path_factory.mktemp("pages")
    beds, weather = folder / "beds", folder / "weather"
    noon = recorded(beds)
    succeed("init", "--simulated", weather)
    without_camera(weather / "fieldkit.toml")
    cloudy = (*AT_ONCE, "--set", 'simulation.faults=["cloud"]')
    for campaign, name, chosen in ((beds, "cloudy", cloudy), (weather, "weather", AT_ONCE)):
        succeed("record", "-C", campaign, "--name", name, "--for", "12m", *chosen)
    made = {name: folder / f"{name}.html" for name in PAGES}
    (rain,) = weather.glob("recordings/*weather.h5")
    succeed("report", noon, "-o", made["session"])
    succeed("report", rain, "-o", made["weather"])
    succeed("report", *beds.glob("recordings/*.h5"), "-o", made["campaign"])
    succeed("plan", "-C", beds, "--on", "2026-12-11", "--for", "20m", "--out", made["plan"])
    succeed("study", "--slopes", "50", "--estimator", "unit-norm", "--out", folder / "study")
    made["study"] = folder / "study" / "study.html"
    return made


def without_camera(config: Path) -> None:
    """Leave light meter and thermometers: a session of the weather alone."""
    written = config.read_text(encoding="utf-8")
    meters = re.sub(r"\[camera\]\n(?:[^\[].*\n)+", "", written[: written.index("[[region]]")])
    config.write_text(meters, encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "scheme"),
    [
        *((name, "light") for name in PAGES),
        *((name, "dark") for name in ("session", "plan", "study")),
        # in the colours of the first
        *(pytest.param(name, "dark", marks=pytest.mark.slow) for name in ("weather", "campaign")),
    ],
)
def test_axe_finds_nothing_and_nothing_is_fetched(browser, pages, name, scheme):
    watched = opened(browser, pages[name].as_uri(), DESK, color_scheme=scheme)
    assert watched.violations() == []
    assert watched.foreign == []
    assert watched.errors == []


@pytest.mark.parametrize("size", [DESK, PHONE])
def test_the_first_screen_shows_slopes_frame_and_the_state_of_the_data(browser, pages, size):
    page = opened(browser, pages["session"].as_uri(), size).page
    for part in (".slopes tr:last-child", ".picture svg", ".sound li, .sound p"):
        box = page.locator(part).first.bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["y"] + box["height"] <= size[1], part
    assert re.search(r"b15\s+[\d.]+\s+(±|\()[\d.]+", page.locator(".slopes").inner_text())


def as_served(browser: Browser, report: Path) -> Page:
    """A report under the field page's policy, which allows no script."""
    page = browser.new_context(viewport={"width": 1200, "height": 800}).new_page()
    policy = {"content-security-policy": REPORT_POLICY, "content-type": "text/html"}
    page.route("**/*", lambda route: route.fulfill(path=report, headers=policy))
    page.goto("http://page.invalid/")
    return page


def test_values_are_shown_by_pointer_and_arrow_keys_without_a_script(browser, pages):
    page = as_served(browser, pages["session"])
    tilts = page.locator(".drawing:has(.readings)").first
    tilts.scroll_into_view_if_needed()
    box = tilts.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    (shown,) = page.evaluate(SHOWN)
    assert re.match(r"12:0\d\nb05 .*°.*\nb15 .*°.*\nb25 .*°", shown)
    page.mouse.move(1, 1)
    assert page.evaluate(SHOWN) == []
    tilts.locator("input").first.focus()
    for minute in (1, 2):
        page.keyboard.press("ArrowRight")
        (shown,) = page.evaluate(SHOWN)
        assert shown.startswith(f"12:0{minute}")


def test_parts_of_a_figure_are_hidden_without_a_script(browser, pages):
    page = as_served(browser, pages["session"])
    assert page.evaluate(HIDDEN_PARTS) == []
    page.locator("figure", has_text="regions by the camera").get_by_label("b05", exact=True).uncheck()
    assert page.evaluate(HIDDEN_PARTS) == ["part-1"]  # flat is part 0


def test_every_axis_of_a_session_without_camera_has_its_line(browser, pages):
    page = opened(browser, pages["weather"].as_uri(), DESK).page
    points = page.evaluate(POINTS_OF_LINES)
    assert len(points) == 3  # probes, illuminance, irradiance
    assert min(points[1:]) >= 12  # one a minute; probes are marks without a line
    words = page.locator("main").inner_text()
    assert "Tilt" not in words
    assert "frame" not in words


@pytest.mark.parametrize("name", ["session", "weather", "campaign"])
def test_simulated_sessions_say_so(browser, pages, name):
    page = opened(browser, pages[name].as_uri(), PHONE).page
    assert page.locator(".simulated").inner_text().startswith("Simulated.")


@pytest.mark.parametrize("name", PAGES)
def test_no_page_scrolls_sideways_and_a_print_breaks_neither_after_a_heading_nor_within_a_row(
    browser, pages, name
):
    page = opened(browser, pages[name].as_uri(), PHONE, color_scheme="dark").page
    for width in (390, 800):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") == width
    page.emulate_media(media="print")
    assert page.evaluate(BREAKS, ["h2, h3", "breakAfter"]) in (["avoid"], [])
    assert page.evaluate(BREAKS, ["p, li, tr", "breakInside"]) == ["avoid"]
    for hidden in (".parts", ".readings", "details:not([open], .printed)"):
        assert page.locator(f"{hidden}:visible").count() == 0


def test_an_exported_video_plays(browser, pages):
    folder = pages["session"].parent
    (noon,) = folder.glob("beds/recordings/*short.h5")
    succeed("export", noon, "--to", "video", "--every", 5, "-o", folder / "video")
    (video,) = (folder / "video").glob("*.mp4")
    (folder / "video.html").write_text(f'<video src="video/{video.name}" muted></video>', encoding="utf-8")
    page = browser.new_page()
    page.goto((folder / "video.html").as_uri())
    page.wait_for_function("document.querySelector('video').readyState === 4")
    # every fifth of 36 frames, at 25 a second
    assert page.evaluate("document.querySelector('video').duration") == pytest.approx(8 / 25, abs=0.02)
