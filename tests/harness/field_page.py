"""The field page in Debian's Chromium, driven by playwright, with every foreign request aborted."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import sync_playwright

from fieldkit.page.keys import Keys
from fieldkit.page.viewer import Role
from tests.harness.command_line import program
from tests.harness.page import free_port
from tests.harness.waiting import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page, Route

PHONE, PHONE_ON_ITS_SIDE, LAPTOP = (360, 740), (740, 360), (1280, 800)
SMALLEST = (320, 568)
PATIENCE_MS = 1000 * PATIENCE_S
AXE = "FIELDKIT_AXE"
RULES = ["wcag2a", "wcag2aa", "wcag2aaa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
AXE_SCRIPT = """async (rules) => (await axe.run(document, {runOnly: rules})).violations.map(
    (violation) => violation.id + ": " + violation.nodes.map((node) => node.target).join(", "))"""


@contextmanager
def chromium() -> Iterator[Browser]:
    """The system's Chromium without a window."""
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("no chromium here: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@dataclass
class Served:
    """A running ``fieldkit page``."""

    folder: Path
    settings: Sequence[str] = ()
    port: int = field(default_factory=free_port)
    process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start the server, and wait until it listens."""
        chosen = [word for setting in self.settings for word in ("--set", setting)]
        self.process = program("page", "-C", self.folder, "--port", self.port, *chosen, stdout=None)
        assert self.process.stderr is not None
        printed = "".join(itertools.takewhile(lambda line: "Ctrl-C" not in line, self.process.stderr))
        assert f"control  {self.address}#" in printed, printed

    @property
    def address(self) -> str:
        """The page without a key."""
        return f"http://127.0.0.1:{self.port}/"

    def link(self, role: Role = "control") -> str:
        """A link that works once."""
        key = Keys(self.folder / "recordings").new_link(role)
        return f"{self.address}#{key}"

    def kill(self) -> None:
        """End the server at once, as a power failure would."""
        assert self.process is not None
        self.process.kill()
        self.process.communicate()

    def stop(self) -> None:
        """End the recording, if one runs, and the server."""
        if list((self.folder / "recordings").glob("*.journal")):
            program("stop", "-C", self.folder).communicate()
        assert self.process is not None
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.kill()


@contextmanager
def served(folder: Path, *settings: str) -> Iterator[Served]:
    """A campaign's page, ended with its recording when the block is left."""
    page = Served(folder, settings)
    page.start()
    try:
        yield page
    finally:
        page.stop()


@dataclass
class Watched:
    """A browser's page with everything it asked for elsewhere and every error on its console."""

    page: Page
    foreign: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.set_default_timeout(PATIENCE_MS)
        self._devtools = self.page.context.new_cdp_session(self.page)
        self.page.on("console", lambda message: message.type == "error" and self.errors.append(message.text))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))

    @property
    def state(self) -> str:
        """The line that says what is going on."""
        return self.page.locator("#state").inner_text()

    def wait_for_picture(self) -> None:
        """Wait until a picture is drawn."""
        self.page.locator("#low", has_text=re.compile("[0-9]")).wait_for()

    def said(self, words: str) -> None:
        """Wait until the page has answered with these words."""
        self.page.locator("#answers", has_text=re.compile(words)).wait_for()

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where a camera's pixel is on the screen."""
        box = self.page.locator("#stage").bounding_box()
        cols, rows = self.page.evaluate(
            "[document.getElementById('pixels').width, document.getElementById('pixels').height]"
        )
        assert box is not None
        return box["x"] + (x + 0.5) * box["width"] / cols, box["y"] + (y + 0.5) * box["height"] / rows

    def drag(self, start: tuple[float, float], end: tuple[float, float], *, lift: bool = True) -> None:
        """Drag a finger from one camera pixel to another."""
        (x0, y0), (x1, y1) = self.place(*start), self.place(*end)
        for step in range(9):
            point = {"x": x0 + (x1 - x0) * step / 8, "y": y0 + (y1 - y0) * step / 8}
            kind = "touchMove" if step else "touchStart"
            self._devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [point]})
        if lift:
            self.lift()

    def lift(self) -> None:
        """Lift the finger; a tap that follows at once would only end the movement."""
        self._devtools.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        self.page.wait_for_timeout(500)

    def tap(self, x: float, y: float) -> None:
        """Tap a camera pixel."""
        self.page.touchscreen.tap(*self.place(x, y))

    def tab_to(self, selector: str, *, backwards: bool = False) -> None:
        """Press Tab until an element has the focus."""
        for _ in range(80):
            if self.page.evaluate("(selector) => document.activeElement.matches(selector)", selector):
                return
            self.page.keyboard.press("Shift+Tab" if backwards else "Tab")
        raise AssertionError(f"{selector} cannot be reached by Tab")

    def violations(self) -> list[str]:
        """What axe finds against the guidelines for accessibility, AAA contrast among them."""
        if not self.page.evaluate("typeof axe !== 'undefined'"):
            self.page.evaluate(axe_source())
        found: list[str] = self.page.evaluate(AXE_SCRIPT, RULES)
        return found


def axe_source() -> str:
    """The text of axe-core, from the folder that its variable names; skips the test without it."""
    folder = os.environ.get(AXE)
    if folder is None:
        pytest.skip(f"no axe-core: npm install --prefix FOLDER axe-core, and {AXE}=FOLDER")
    return (Path(folder) / "node_modules/axe-core/axe.js").read_text(encoding="utf-8")


def opened(browser: Browser, link: str, size: tuple[int, int] = PHONE, **options: Any) -> Watched:
    """The page behind a link in a browser of its own, with touch."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, has_touch=True, **options)
    return another(context, link)


def another(context: BrowserContext, link: str) -> Watched:
    """One more tab in a browser."""
    watched = Watched(context.new_page())
    host = urlsplit(link).netloc

    def only_own(route: Route) -> None:
        address = urlsplit(route.request.url)
        if address.scheme in ("data", "blob") or address.netloc == host:
            route.continue_()
        else:
            watched.foreign.append(route.request.url)
            route.abort()

    context.route("**/*", only_own)
    watched.page.goto(link)
    return watched
