"""The fail-safe output: a serial line hangs up, and a command runs, when the recording is over or dead.

A child process keeps the line's DTR raised for as long as the recorder sends it bytes. The recorder's end,
however it comes (kill -9 too), closes the pipe between them at once; of one that hangs, or waits for a dead
disk, nothing comes for `SILENT_S`. In both cases the line hangs up; it is raised again if the recorder comes
back. The child is this file, run as a program: it imports the standard library alone.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress

SILENT_S = 4.0
"""Time without a byte after which the recorder counts as dead; 5 s are promised."""


class FailSafe:
    """A view that keeps the output in its normal state; it raises once the child is gone."""

    def __init__(self, line: str, command: Sequence[str]) -> None:
        """Raise the line; raises `OSError` where that is not possible."""
        self._child = subprocess.Popen(
            [sys.executable, "-I", __file__, line, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self._pipe = self._child.stdin.fileno()
        os.set_blocking(self._pipe, False)
        with self._child.stdout as reply:
            if (problem := reply.readline().decode().strip()) != "ready":
                self.close()
                raise OSError(problem)

    def show(self, item: object) -> None:
        """Send a sign of life with everything that the recorder has stored."""
        with suppress(BlockingIOError):
            os.write(self._pipe, b".")

    def close(self) -> None:
        """The recording is over: let the line hang up; a second call does nothing."""
        assert self._child.stdin is not None
        self._child.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._child.wait(SILENT_S)


def _raised(line: str) -> int | None:
    """The line's file, whose opening raises DTR; its close, of a killed child too, has the kernel drop it."""
    import termios

    if not line:
        return None
    port = os.open(line, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    attributes = termios.tcgetattr(port)
    attributes[2] |= termios.HUPCL | termios.CLOCAL
    termios.tcsetattr(port, termios.TCSANOW, attributes)
    return port


def _watch(line: str, command: Sequence[str]) -> None:
    """Keep the line up while bytes come on stdin; whenever they end, hang it up and run the command."""
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):  # of the recorder's group: it seals first
        signal.signal(number, signal.SIG_IGN)
    port = _raised(line)
    os.write(1, b"ready\n")
    # a recording may wait for its time or trigger: the first sign of life is awaited for as long as it takes
    is_up, wait_s, sign = True, None, b"."
    while sign:
        is_alive = bool(select.select([0], [], [], wait_s)[0])
        sign = os.read(0, 4096) if is_alive else sign
        is_alive, wait_s = is_alive and bool(sign), SILENT_S
        if is_up and not is_alive:
            if port is not None:
                os.close(port)
            if command:
                subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
        elif is_alive and not is_up:
            port = _raised(line)
        is_up = is_alive


if __name__ == "__main__":
    try:
        _watch(sys.argv[1], sys.argv[2:])
    except OSError as problem:
        os.write(1, f"{problem.filename or ''} {problem.strerror}\n".encode(errors="replace"))
