"""What the page has other processes do ends with it."""

import asyncio
import gc
import os
from pathlib import Path

import pytest

from fieldkit.config import load_config
from fieldkit.page import sessions
from fieldkit.page.sessions import PastSessions, _fieldkit, identifier
from fieldkit.recording.campaign import init_campaign
from fieldkit.results.report import default_path


def test_a_command_of_a_page_that_ends_is_ended_and_its_pipes_are_closed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    async def page() -> None:
        asyncio.create_task(_fieldkit("demo", "--fast")).add_done_callback(ended.append)
        await asyncio.sleep(0.5)  # until the process has begun

    ended: list[asyncio.Task[tuple[int, str, str]]] = []
    asyncio.run(page())
    assert ended[0].cancelled()
    gc.collect()  # what is left open warns here, and a warning is an error


@pytest.fixture
def session(tmp_path):
    """The only session of a campaign."""
    init_campaign(tmp_path / "field", simulated=True)
    session = tmp_path / "field/recordings/day.h5"
    session.parent.mkdir(exist_ok=True)
    session.write_bytes(b"")
    return session


def sessions_beside(session: Path) -> PastSessions:
    return PastSessions(load_config(session.parents[1] / "fieldkit.toml"))


def test_a_report_opens_once_it_is_made_though_the_clock_is_behind_that_of_the_session(session, monkeypatch):
    os.utime(session, (2e9, 2e9))  # as after a start without network or battery-backed clock

    async def made(*_: str) -> tuple[int, str, str]:
        default_path(session).write_text("made", encoding="utf-8")
        return 0, "", ""

    async def asked() -> Path:
        past = sessions_beside(session)
        making = past.product("report", identifier(session))
        assert isinstance(making, asyncio.Task)
        await making
        report = past.product("report", identifier(session))
        assert isinstance(report, Path), "it is made again and again"
        return report

    monkeypatch.setattr(sessions, "_fieldkit", made)
    assert asyncio.run(asked()).read_text(encoding="utf-8") == "made"


def test_a_report_waits_for_one_check_at_most(session, monkeypatch):
    began: list[str] = []

    async def works(command: str, *_: str) -> tuple[int, str, str]:
        began.append(command)
        await asyncio.sleep(0)
        return 0, '{"sessions": [{"findings": []}]}', ""

    async def asked() -> None:
        past = sessions_beside(session)
        checks = [asyncio.create_task(past.check(identifier(session))) for _ in range(5)]
        await asyncio.sleep(0)  # they begin, or wait
        report = past.product("report", identifier(session))
        assert isinstance(report, asyncio.Task)
        await asyncio.gather(report, *checks)

    monkeypatch.setattr(sessions, "_fieldkit", works)
    asyncio.run(asked())
    assert began == ["check", "report", "check", "check", "check", "check"]
