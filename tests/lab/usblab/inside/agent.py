"""The command loop of the guest: JSON lines over the virtio port, one interpreter kept alive.

A line requests one operation and is answered by one line. Importing large libraries takes seconds on an
emulated processor, so the program under test runs in a fork of this process, which has imported them: the
same function the installed script calls, in its own process, under the requested user.
"""

from __future__ import annotations

import base64
import contextlib
import faulthandler
import importlib
import io
import json
import os
import pwd
import signal
import sys
import traceback
from pathlib import Path
from typing import Any

PORT = "/dev/vport0p1"


class Agent:
    """Operations by name; what they return goes back to the test process."""

    def __init__(self) -> None:
        self._running: dict[int, Path] = {}
        self._ended: dict[int, int] = {}

    def call(self, function: str, arguments: dict[str, Any]) -> Any:
        """Call ``module:name`` in this process."""
        module, _, name = function.partition(":")
        return getattr(importlib.import_module(module), name)(**arguments)

    def start(self, arguments: list[str], user: str, folder: str, output: str, entry: str = "") -> int:
        """Run a program in the background, or the function `entry` as its command; its process id.

        Standard output and standard error go to ``output.out`` and ``output.err``.
        """
        process = os.fork()
        if process == 0:
            self._become(arguments, user, folder, output, entry)
        self._running[process] = Path(output)
        return process

    def ended(self, process: int) -> dict[str, Any] | None:
        """How a process ended (negative: by that signal) and what it wrote, or None while it runs."""
        if process not in self._ended:
            done, status = os.waitpid(process, os.WNOHANG)
            if not done:
                return None
            self._ended[process] = os.waitstatus_to_exitcode(status)
        output = self._running[process]
        return {
            "code": self._ended[process],
            "out": output.with_suffix(".out").read_text(errors="replace"),
            "err": output.with_suffix(".err").read_text(errors="replace"),
        }

    def signal(self, process: int, number: int) -> None:
        """Send a signal to a process started here."""
        os.kill(process, number)

    def put(self, path: str, content: str, user: str) -> None:
        """Write a file (base64) for a user, with its folder."""
        target = Path(path)
        account = pwd.getpwnam(user)
        for folder in reversed([p for p in target.parents if not p.exists()]):
            folder.mkdir()
            os.chown(folder, account.pw_uid, account.pw_gid)
        target.write_bytes(base64.b64decode(content))
        os.chown(target, account.pw_uid, account.pw_gid)

    def stderr(self, process: int) -> str:
        """What a process started here has written to standard error so far."""
        return self._running[process].with_suffix(".err").read_text(errors="replace")

    def _become(self, arguments: list[str], user: str, folder: str, output: str, entry: str) -> None:
        code = 1
        try:
            os.setsid()
            for stream, ending in ((1, ".out"), (2, ".err")):
                file = os.open(output + ending, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
                os.dup2(file, stream)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            _log_in(user)
            os.chdir(folder)
            code = _command(entry, arguments) if entry else os.execvp(arguments[0], arguments)
        except BaseException:
            traceback.print_exc()
        finally:
            with contextlib.suppress(Exception):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)


def _log_in(user: str) -> None:
    account = pwd.getpwnam(user)
    os.initgroups(user, account.pw_gid)
    os.setgid(account.pw_gid)
    os.setuid(account.pw_uid)
    os.environ.update(HOME=account.pw_dir, USER=user)


def _command(entry: str, arguments: list[str]) -> int:
    """The exit code of a command whose function is `entry`, ``module:name``."""
    module, _, name = entry.partition(":")
    main = getattr(importlib.import_module(module), name)
    faulthandler.enable()  # a command that hangs is ended by SIGABRT and then shows where it was
    sys.argv = arguments
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def serve(port: str = PORT) -> None:
    """Answer requests until one is to stop or the other side closes."""
    agent = Agent()
    with io.FileIO(port, "r+b") as channel:
        channel.write(b'{"result": "hello"}\n')
        waiting = b""
        while True:
            while b"\n" not in waiting:
                waiting += channel.read(65536)
            line, waiting = waiting.split(b"\n", 1)
            request = json.loads(line)
            if request["do"] == "stop":
                return
            _write(channel, json.dumps(_answer(agent, request)).encode() + b"\n")


def _write(channel: io.RawIOBase, data: bytes) -> None:
    """All of it: the port takes 32 KiB at a time."""
    while data:
        data = data[channel.write(data) or 0 :]


def _answer(agent: Agent, request: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"result": getattr(agent, request["do"])(**request["with"])}
    except Exception:
        return {"error": traceback.format_exc()}


if __name__ == "__main__":
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    sys.path.insert(0, "/lab")
    serve()
