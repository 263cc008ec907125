"""A colleague's laptop runs Windows: what reads sessions needs nothing that only POSIX has."""

from pathlib import Path

from tests.harness.command_line import run_code

SESSION = Path(__file__).parents[1] / "data" / "sessions" / "2.0.h5"

# what Python's own reference marks "Availability: Unix" and some of it is used where sessions are recorded
PROGRAM = """
import os, select, shutil, signal, socket, sys, time
from pathlib import Path
import h5py, matplotlib, platformdirs, rich.console  # these choose by the system, which is still Linux

class Absent:
    MODULES = ("crypt", "fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty")

    def find_spec(self, name, path=None, target=None):
        if name in self.MODULES:
            raise ModuleNotFoundError(name, name=name)

for module in Absent.MODULES:
    sys.modules.pop(module, None)
sys.meta_path.insert(0, Absent())
ABSENT = {
    os: "fork geteuid getuid killpg setsid statvfs sched_getaffinity posix_fadvise posix_fallocate "
        "O_DIRECTORY O_PATH O_NOFOLLOW O_CLOEXEC O_NONBLOCK mkfifo uname pread pwrite fchmod fdatasync "
        "memfd_create nice",
    signal: "SIGKILL SIGHUP SIGALRM SIGUSR1 SIGUSR2 SIGCHLD SIGPIPE SIGQUIT pthread_sigmask setitimer",
    select: "poll epoll",
    socket: "AF_UNIX",
    time: "clock_gettime clock_gettime_ns CLOCK_REALTIME CLOCK_MONOTONIC CLOCK_BOOTTIME tzset",
}
for module, names in ABSENT.items():
    for name in names.split():
        delattr(module, name)

import fieldkit

session, folder = Path(sys.argv[1]), Path(sys.argv[2])
for name in ("a.h5", "b.h5"):
    shutil.copy(session, folder / name)
with fieldkit.open_session(folder / "a.h5") as opened:
    assert len(opened["camera"]) == 10
assert fieldkit.estimate(folder / "a.h5")["b05"]
fieldkit.report(folder / "a.h5", folder / "a.html")
fieldkit.report([folder / "a.h5", folder / "b.h5"], folder / "both.html")
assert fieldkit.check(folder / "a.h5")
"""


def test_sessions_are_read_estimated_and_reported_without_posix(tmp_path):
    run_code(PROGRAM, SESSION, tmp_path, timeout=120)
    assert (tmp_path / "a.html").stat().st_size > 10_000
    assert (tmp_path / "both.html").exists()
