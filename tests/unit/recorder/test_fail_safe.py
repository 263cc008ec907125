"""The fail-safe output on a real pseudo-terminal: it hangs up when its recorder ends, hangs or is killed."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from fieldkit.recorder.fail_safe import FailSafe
from tests.harness.waiting import wait_until

PROMISED_S = 5.0
RECORDER = """
import sys, time
from fieldkit.recorder.fail_safe import FailSafe
output = FailSafe(sys.argv[1], sys.argv[2:])
output.show(None)
print("up", flush=True)
while True:
    output.show(None)
    time.sleep(0.2)
"""


class Line:
    """The far end of a serial line, which sees whether the near end has hung up."""

    def __init__(self) -> None:
        self._far, near = pty.openpty()
        self.path = os.ttyname(near)
        os.close(near)
        self._poll = select.poll()
        self._poll.register(self._far, select.POLLHUP)

    @property
    def is_up(self) -> bool:
        return not self._poll.poll(0)

    def hangs_up_within_s(self) -> float:
        started_s = time.monotonic()
        wait_until(lambda: not self.is_up, "it does not hang up", every_s=0.02)
        return time.monotonic() - started_s


@contextmanager
def recorder(line: Line, *command: str):
    words = [sys.executable, "-c", RECORDER, line.path, *command]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "up\n"
        assert line.is_up
        yield process
        process.kill()


def test_a_killed_recorder_hangs_up_and_runs_the_command(tmp_path):
    line, tripped = Line(), tmp_path / "tripped"
    with recorder(line, "touch", str(tripped)) as process:
        assert not tripped.exists()
        process.send_signal(signal.SIGKILL)
        assert line.hangs_up_within_s() < PROMISED_S
    wait_until(tripped.exists, "the command does not run", every_s=0.02)


def test_a_recorder_that_stands_still_hangs_up_until_it_goes_on():
    line = Line()
    with recorder(line) as process:
        process.send_signal(signal.SIGSTOP)
        assert line.hangs_up_within_s() < PROMISED_S
        process.send_signal(signal.SIGCONT)
        wait_until(lambda: line.is_up, "it is not raised again", every_s=0.02)


def test_it_hangs_up_at_the_end_and_one_that_is_gone_is_noticed():
    line = Line()
    output = FailSafe(line.path, [])
    output.show(None)
    output.close()
    output.close()
    assert line.hangs_up_within_s() < PROMISED_S
    output = FailSafe(line.path, [])
    output._child.kill()
    output._child.wait()
    with pytest.raises(BrokenPipeError):
        output.show(None)
    output.close()


def test_a_line_that_is_none_is_refused():
    with pytest.raises(OSError, match="/nonexistent"):
        FailSafe("/nonexistent", [])
