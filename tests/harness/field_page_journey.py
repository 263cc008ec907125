"""A first user's journey through the field page: draw two regions, record, mark, be warned, stop, report.

Shared by the test in the browser and by the script that takes the pictures of the documentation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fieldkit.config import FILE_NAME
from fieldkit.config.edit import editing, set_key
from fieldkit.config.template import SIMULATED
from fieldkit.recording.campaign import create_campaign
from tests.harness.field_page import PATIENCE_MS, Watched
from tests.harness.waiting import wait_until

FLAT = ((22, 79), (62, 100))
B15 = ((32, 31), (62, 50))
B25 = ((97, 31), (127, 50))
"""Opposite corners of rectangles on three beds of the simulated field."""
SPEED = 30.0
SETTINGS = ('simulation.faults=["moved"]',)
FAULT = re.compile("camera")
TOUCH_S, KEY_S = 1.35 + 2 * 1.1, 0.28
"""Decide, point, and for a drag point again; press a key, on average. Card, Moran and Newell, The
keystroke-level model for user performance time with interactive systems, CACM 23 (1980) 396."""
COUNT_STEPS = """() => {
    window.steps = {touches: 0, keys: 0};
    addEventListener("pointerdown", () => steps.touches++, true);
    addEventListener("input", (event) => {
        if (event.target.type === "radio") return;
        steps.touches++;  // of the field that is filled in
        steps.keys += event.target.value.length;
    }, true);
}"""
Shoot = Callable[[str, Watched], None]


def user_s(watched: Watched) -> float:
    """Seconds that a person needs for the steps since `COUNT_STEPS`, however fast the machine."""
    steps = watched.page.evaluate("steps")
    print(steps)
    return float(steps["touches"] * TOUCH_S + steps["keys"] * KEY_S)


def empty_campaign(folder: Path) -> Path:
    """A campaign on simulated devices without regions."""
    create_campaign(folder, {key: table for key, table in SIMULATED.items() if key != "region"})
    return folder


@contextmanager
def quick(campaign: Path) -> Iterator[None]:
    """What is started here runs at `SPEED`; a preview that did would draw hundreds of frames a second."""
    with editing(campaign / FILE_NAME) as draft:
        set_key(draft, "simulation", "speed", SPEED)
    yield
    with editing(campaign / FILE_NAME) as draft:
        set_key(draft, "simulation", "speed", 1.0)


def draw(
    watched: Watched,
    name: str,
    corners: tuple[tuple[float, float], tuple[float, float]],
    shoot: Shoot,
    tilt: str = "",
) -> None:
    """Draw a rectangle with a finger, describe it and save it."""
    page = watched.page
    page.locator("#draw").tap()
    if not tilt:
        watched.drag(*corners)
    else:
        watched.drag(*corners, lift=False)
        shoot("drawing", watched)
        watched.lift()
    page.locator("#verdict-text", has_text=re.compile(r"\d px")).wait_for()
    page.locator("#drawing [name=name]").fill(name)
    if tilt:
        page.locator("#drawing [name=tilt_deg]").fill(tilt)
        page.locator("#drawing [name=azimuth_deg]").fill("180")
        shoot("region", watched)
    page.locator("#save-region").tap()
    page.locator(f"#card-{name}").wait_for()


def record(watched: Watched, shoot: Shoot) -> None:
    """Start a recording that has a fault in its middle, and wait for slopes."""
    page = watched.page
    page.locator("#start").tap()
    page.locator("#start-dialog [name=name]").fill("two-beds")
    page.locator("#start-dialog [name=ends][value=duration]").check()
    page.locator("#start-dialog [name=duration]").fill("24m")
    shoot("start", watched)
    page.get_by_role("button", name="Start recording").tap()
    watched.said("two-beds")
    wait_until(lambda: "Recording" in watched.state, "it does not record")
    page.locator("#cards .card", has_text="b15").locator("dd", has_text="±").first.wait_for()
    shoot("slopes", watched)


def mark(watched: Watched, shoot: Shoot) -> None:
    """Note a cloud half a minute ago."""
    page = watched.page
    page.locator("#mark").tap()
    page.locator("#mark-dialog [name=kind][value=cloud]").check()
    page.locator("#mark-dialog [name=text]").fill("over the ridge")
    page.locator("#mark-dialog [name=at][value='-30s']").check()
    shoot("mark", watched)
    page.get_by_role("button", name="Save mark").tap()
    page.locator("#event-list li", has_text="over the ridge").wait_for()


def be_warned(watched: Watched, shoot: Shoot) -> None:
    """Wait for the alarm of the camera that was kicked and acknowledge it."""
    alarm = watched.page.locator("#alarms .alarm", has_text=FAULT).first
    alarm.wait_for()
    shoot("alarm", watched)
    alarm.get_by_role("button", name="Acknowledge").tap()


def stop(watched: Watched, shoot: Shoot) -> None:
    """Stop the recording after the question, and wait until it is sealed."""
    page = watched.page
    page.locator("#stop").tap()
    shoot("stop", watched)
    page.get_by_role("button", name="Stop and seal").tap()
    wait_until(lambda: "preview" in watched.state, "it does not stop")


def report(watched: Watched, shoot: Shoot) -> str:
    """Open the report of the session; its title."""
    page = watched.page
    page.locator("#list-sessions").tap()
    link = page.locator("#session-list a", has_text="Report").first
    link.wait_for()
    shoot("sessions", watched)
    with page.context.expect_page() as opening:
        link.tap()
    opened = opening.value
    opened.locator("svg").first.wait_for(state="attached", timeout=PATIENCE_MS)
    shoot("report", Watched(opened))
    return opened.title()


def estimate_anew(watched: Watched, shoot: Shoot) -> str:
    """Draw a bed that was forgotten on the session's picture and estimate the session with it; its line."""
    page = watched.page
    page.get_by_role("button", name="Draw regions").first.tap()
    page.locator("#past-title", has_text="two-beds").wait_for()
    draw(watched, "b25", B25, unseen)
    page.locator("#estimate-past").tap()
    line = page.locator("#past-slopes li", has_text="b25")
    line.wait_for()
    shoot("anew", watched)
    words = line.inner_text()
    page.locator("#leave-past").tap()
    page.locator("#past").wait_for(state="hidden")
    return words


def unseen(name: str, watched: Watched) -> None:
    """In place of taking a picture."""
