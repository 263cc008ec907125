"""What the page reports to the service manager that started it: ready, alive, and what it shows."""

from __future__ import annotations

import asyncio

from fieldkit.page.hub import Hub, Phase, State
from fieldkit.views.service_manager import notify

EVERY_S = 5.0
WORDS: dict[Phase, str] = {
    "preview": "no recording; the page shows the instruments",
    "starting": "a recording is starting",
    "waiting": "a recording waits for its time",
    "recording": "a recording that was started elsewhere goes on",
    "sealing": "the session is being sealed",
    "no-instruments": "no recording, no instruments",
}


async def report(hub: Hub) -> None:
    """Report that the page is ready, then that it is alive, until cancelled.

    A recording that the page started reports its own progress: then the page keeps silent, because a page
    that works proves nothing about the recorder.
    """
    notify("READY=1")
    while True:
        if not _recorder_reports(hub.state):
            notify("WATCHDOG=1", f"STATUS={hub.state.problem or WORDS[hub.state.phase]}")
        await asyncio.sleep(EVERY_S)


def _recorder_reports(state: State) -> bool:
    return state.phase == "recording" and state.ours
