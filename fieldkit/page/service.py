"""The page as a service: the recording that it keeps running, and its reports to the service manager."""

from __future__ import annotations

import asyncio
import logging
import threading

from fieldkit.model.errors import DeviceError, DeviceLostError, FieldkitError
from fieldkit.page.conductor import Conductor
from fieldkit.page.hub import Hub
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.recordings import is_interrupted, sessions_in
from fieldkit.recording.request_reader import recover_session
from fieldkit.views.service_manager import notify

NAME = "unattended"
AGAIN_AFTER_S = 30.0
MAY_PASS = (1, DeviceError.exit_code, DeviceLostError.exit_code)
"""Exit codes of a recorder that may work the next time; wrong configurations and full disks need a person."""
log: logging.Logger = logging.getLogger(__name__)


def keep_recording(conductor: Conductor, ending: threading.Event) -> None:
    """Record until `ending` is set or a person stops the recording; a recorder that fails is started again.

    What it leaves is recovered first. Nothing is started where another recording runs. With triggers that
    start one, it waits for them.
    """
    on_trigger = any(trigger.do == "start" for trigger in conductor.config.tables.trigger.values())
    while not ending.is_set():
        try:
            conductor.start(RecordOptions(name=NAME, on_trigger=on_trigger))
        except FieldkitError as error:
            log.warning("no recording was started: %s", error)
        code = conductor.exit_code(ending)
        if code is None or (code >= 0 and code not in MAY_PASS):
            return
        log.warning("the recording ended with exit code %d; the next one begins in %g s", code, AGAIN_AFTER_S)
        if not ending.wait(AGAIN_AFTER_S):
            _recover(conductor)


def _recover(conductor: Conductor) -> None:
    for path in sessions_in(conductor.config.recordings):
        try:
            if is_interrupted(path):
                recover_session(path)
        except FieldkitError as error:  # the next recording does not depend on it
            log.warning("%s was not recovered: %s", path.name, error)


REPORT_EVERY_S = 5.0


async def report_page(hub: Hub) -> None:
    """Report that the page is ready, then that it is alive, until cancelled.

    A recording that the page started reports its own progress: then the page keeps silent, because a page
    that works proves nothing about the recorder.
    """
    notify("READY=1")
    while True:
        if not (hub.state.ours and hub.state.phase == "recording"):
            notify("WATCHDOG=1", f"STATUS={hub.state.problem or hub.state.phase}")
        await asyncio.sleep(REPORT_EVERY_S)
