"""Light commands in fresh processes, beside importing click.

Those beside a recording work on a simulated one in a process of its own.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.result import Result, Row
from benchmarks.sides import python_process, share
from fieldkit.recording.running import session_in_progress
from fieldkit.recording.status_request import recorder_status

ROUNDS = 15
BARE = "import click"
HELP = "from fieldkit.cli import main; main(['--help'], prog_name='fieldkit')"
PROCESS = "CPU of a fresh process, interpreter included"
OVER_CLICK = Row("help", "`fieldkit --help` over `python -c 'import click'`", "<= 1.3", included=PROCESS)


def _light(command: str, included: str = PROCESS) -> Row:
    title = f"`fieldkit {command}` over `python -c 'import click'`"
    return Row(command.strip("-"), title, "<= 3", included=included)


VERSION, MARK, STATUS = _light("--version"), _light("mark"), _light("status")
SHUTTER, LIST = _light("shutter"), _light("ls")
STOP = _light("stop", f"{PROCESS}, until the recording is sealed; measured once in a run")


def run() -> list[Result]:
    """Fresh processes, taken in turn."""
    return [_help(), *_beside_a_recording()]


def _help() -> Result:
    for code in (HELP, BARE):
        python_process("-c", code)  # warm: compiled files and disk cache
    rounds = [(python_process("-c", HELP)[0], python_process("-c", BARE)[0]) for _ in range(ROUNDS)]
    return share(OVER_CLICK, rounds)


def _beside_a_recording() -> list[Result]:
    """Each command against bare click, in turn; the last one stops the recording."""
    with _recording() as folder:
        of_row = {
            VERSION: ["--version"],
            MARK: ["mark", "-C", folder, "wind"],
            STATUS: ["status", "-C", folder],
            SHUTTER: ["shutter", "-C", folder],
            LIST: ["ls", "-C", folder],
        }
        shares = [share(row, [_against_click(words) for _ in range(ROUNDS)]) for row, words in of_row.items()]
        return [*shares, share(STOP, [_against_click(["stop", "-C", folder])])]


@contextmanager
def _recording() -> Iterator[str]:
    """The folder of a campaign that is being recorded, once its recorder reports its status."""
    command = [sys.executable, "-m", "fieldkit"]
    with tempfile.TemporaryDirectory() as parent:
        folder = str(Path(parent, "field"))
        subprocess.run([*command, "init", "--simulated", folder], check=True, capture_output=True)
        recorder = subprocess.Popen([*command, "record", "-C", folder, "--quiet"])
        while not (session := session_in_progress(Path(folder, "recordings"))) or not recorder_status(
            session
        ):
            time.sleep(0.1)
        yield folder
        recorder.kill()
        recorder.wait()


def _against_click(words: list[str]) -> tuple[float, float]:
    code = f"from fieldkit.cli import main; main({words!r}, prog_name='fieldkit')"
    return python_process("-c", code)[0], python_process("-c", BARE)[0]
