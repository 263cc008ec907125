"""A recording by a process of its own."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fieldkit.recording.running import session_in_progress
from tests.harness.command_line import PROGRAM
from tests.harness.waiting import wait_until


@contextmanager
def recorder(campaign: Path, *words: str) -> Iterator[tuple[Path, subprocess.Popen[bytes]]]:
    """The session that ``fieldkit record WORDS`` has begun, and its process, which ends with the test."""
    process = subprocess.Popen([*PROGRAM, "record", "-C", str(campaign), "--quiet", *words])

    def begun() -> Path | None:
        assert process.poll() is None
        return session_in_progress(campaign / "recordings")

    try:
        wait_until(begun, "nothing is recorded", every_s=0.1)
        session = begun()
        assert session is not None
        yield session, process
    finally:
        process.kill()
        process.wait()
