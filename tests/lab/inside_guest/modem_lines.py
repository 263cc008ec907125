"""The modem lines of a serial adapter: as the program reads them, and as the kernel's driver sets them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

RECORDER = """
import sys, time
from fieldkit.recorder.fail_safe import FailSafe
output = FailSafe(sys.argv[1], [])
print("up", flush=True)
while True:
    output.show(None)
    time.sleep(0.2)
"""
PATIENCE_S = 60.0


def values(path: str) -> dict[str, float]:
    """One reading of the modem lines of a port."""
    from fieldkit.drivers.instrument import open_device

    with open_device("text", port=f"lines://{path}") as lines:
        return dict(lines.read().values)


def dtr_drops_after_kill_s(path: str) -> float:
    """Time from kill -9 of a recorder to the adapter's driver having dropped DTR, by its debug messages."""
    with open("/proc/dynamic_debug/control", "w") as control:
        control.write("module ftdi_sio +p")
    log = os.open("/dev/kmsg", os.O_RDONLY | os.O_NONBLOCK)
    os.lseek(log, 0, os.SEEK_END)
    with subprocess.Popen(
        [sys.executable, "-c", RECORDER, path], stdout=subprocess.PIPE, text=True
    ) as recorder:
        assert recorder.stdout is not None
        assert recorder.stdout.readline() == "up\n"
        assert _seen(log, "DTR HIGH")
        begun_s = time.monotonic()
        recorder.send_signal(signal.SIGKILL)
        assert _seen(log, "DTR LOW")
        return time.monotonic() - begun_s


def _seen(log: int, words: str) -> bool:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        try:
            if words in os.read(log, 8192).decode(errors="replace"):
                return True
        except BlockingIOError:
            time.sleep(0.02)
    return False
