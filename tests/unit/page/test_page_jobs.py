"""What the page has other processes do ends with it."""

from __future__ import annotations

import asyncio
import gc
from pathlib import Path

import pytest

from fieldkit.page.sessions import _fieldkit


def test_a_command_of_a_page_that_ends_is_ended_and_its_pipes_are_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    async def page() -> None:
        asyncio.create_task(_fieldkit("demo", "--fast")).add_done_callback(ended.append)
        await asyncio.sleep(0.5)  # until the process has begun

    ended: list[asyncio.Task[tuple[int, str, str]]] = []
    asyncio.run(page())
    assert ended[0].cancelled()
    gc.collect()  # what is left open warns here, and a warning is an error
