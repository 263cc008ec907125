"""What stands in the guest's /dev, as udev and the kernel made it; its clocks."""

from __future__ import annotations

import contextlib
import grp
import os
import stat
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

PATIENCE_S = 60.0
FOLDERS = ("/dev/v4l/by-id", "/dev/serial/by-id")


def present(folders: list[str]) -> dict[str, dict[str, str]]:
    """Every camera, serial and USB node with mode and group, and every stable name with its target.

    `folders` hold stable names besides those that udev always makes.
    """
    nodes = [*_instruments(), *Path("/dev").glob("bus/usb/*/*")]
    links = [
        path for folder in (*FOLDERS, *folders) if Path(folder).exists() for path in Path(folder).iterdir()
    ]
    return {str(path): _about(path) for path in (*nodes, *links)}


def wait_for(path: str, present: bool) -> None:
    """Wait until a node is there, or gone, and udev has done with it."""
    _until(lambda: os.path.exists(path) == present, f"{path} is {'not there' if present else 'still there'}")


def wait_for_none() -> None:
    """Wait until no instrument is left, and udev has done with them."""
    _until(lambda: not _instruments(), "instruments are still there")


def _instruments() -> list[Path]:
    return [path for pattern in ("video*", "ttyUSB*") for path in Path("/dev").glob(pattern)]


def _until(reached: Callable[[], bool], otherwise: str) -> None:
    begun = time.monotonic()
    while not (reached() and _settled()):
        if time.monotonic() - begun > PATIENCE_S:
            raise TimeoutError(f"{otherwise} after {PATIENCE_S} s")
        time.sleep(0.02)  # for nodes that nothing was asked of udev for yet


def _settled() -> bool:
    """Whether udev has done with everything; it also says no when it is too busy to be asked."""
    return subprocess.run(["udevadm", "settle", "--timeout=5"], capture_output=True).returncode == 0


def clock(set_utc_ns: int | None = None) -> tuple[int, int]:
    """The guest's UTC and monotonic nanoseconds, its UTC set first if that is wanted."""
    if set_utc_ns is not None:
        time.clock_settime_ns(time.CLOCK_REALTIME, set_utc_ns)
    return time.time_ns(), time.monotonic_ns()


def idle_s() -> float:
    """For how long the guest's processors have had nothing to do since power-on, on average."""
    return float(Path("/proc/uptime").read_text().split()[1]) / (os.cpu_count() or 1)


def blocked() -> dict[str, str]:
    """Where in the kernel each task stands that cannot be interrupted, by its name and number."""
    found = {}
    for task in Path("/proc").glob("[0-9]*/task/[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            if "State:\tD" in (task / "status").read_text():
                found[f"{(task / 'comm').read_text().strip()} {task.name}"] = (task / "stack").read_text()
    return found


def _about(path: Path) -> dict[str, str]:
    if path.is_symlink():
        return {"to": os.path.realpath(path)}
    status = path.stat()
    return {"mode": f"{stat.S_IMODE(status.st_mode):04o}", "group": grp.getgrgid(status.st_gid).gr_name}
