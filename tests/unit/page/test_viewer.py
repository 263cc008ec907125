"""A viewer receives every text in order and the newest picture, or is disconnected."""

import asyncio

import pytest

from fieldkit.page import viewer as viewers
from fieldkit.page.viewer import Viewer, ViewerLeftError


class Slow:
    """A browser that takes what it is sent once it is ready."""

    def __init__(self) -> None:
        self.ready, self.came, self.taken = asyncio.Event(), asyncio.Event(), []

    async def take(self, message: str | bytes) -> None:
        await self.ready.wait()
        self.taken.append(message)
        self.came.set()


async def until_taken(browser: Slow, last: str | bytes) -> None:
    async with asyncio.timeout(5):
        while last not in browser.taken:
            await browser.came.wait()
            browser.came.clear()


def test_a_slow_browser_misses_pictures_but_no_text():
    async def run() -> list[str | bytes]:
        browser, viewer = Slow(), Viewer("view")
        sending = asyncio.create_task(viewer.send(browser.take, browser.take))
        viewer.text("first")
        await asyncio.sleep(0)  # the sender begins with it
        for number in range(100):
            viewer.picture(b"%d" % number)
        viewer.text("second")
        browser.ready.set()
        await until_taken(browser, b"99")
        sending.cancel()
        return browser.taken

    assert asyncio.run(run()) == ["first", "second", b"99"]


def test_a_browser_that_reads_nothing_is_disconnected():
    async def run() -> None:
        browser, viewer = Slow(), Viewer("view")
        for number in range(viewers.TEXTS_WAITING + 1):
            viewer.text(str(number))
        await viewer.send(browser.take, browser.take)

    with pytest.raises(ViewerLeftError, match="slow"):
        asyncio.run(run())


def test_requests_are_counted_and_the_count_recovers(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])  # at the exact ends of a second
    viewer = Viewer("view")
    for _ in range(viewers.BURST):
        viewer.count_request()
    now[0] += 1.0
    for _ in range(viewers.PER_SECOND):
        viewer.count_request()
    with pytest.raises(ViewerLeftError, match="too_many"):
        viewer.count_request()
