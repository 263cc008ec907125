"""Distribution packages, fetched by name and unpacked; nothing is installed and no root is needed."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from usblab.guest.missing import INSTALL, MissingPartError

KERNEL = "linux-image-amd64"
USERLAND = ("udev", "busybox-static", "libusb-1.0-0")


def _ask(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise MissingPartError(f"`{' '.join(command)}` failed ({error}); run: {INSTALL}") from error


@cache
def _lists() -> str:
    """The entries of all packages of the guest in the package lists; each query takes half a second."""
    return _ask("apt-cache", "show", "--no-all-versions", KERNEL, *USERLAND)


def _field(package: str, pattern: str) -> re.Match[str]:
    paragraphs = _lists().split("\n\n")
    about = next((text for text in paragraphs if text.startswith(f"Package: {package}\n")), "")
    found = re.search(pattern, about, re.MULTILINE)
    if found is None:
        raise MissingPartError(f"{package} is not in the package lists; run: {INSTALL}")
    return found


def kernel_package() -> tuple[str, str]:
    """Name and version of the kernel behind ``linux-image-amd64``; they change with every security update."""
    found = _field(KERNEL, r"^Depends: .*?(linux-image-\S+) \(= (\S+)\)")
    return found[1], found[2]


def version(package: str) -> str:
    """The version of one of `USERLAND` the package lists offer."""
    return _field(package, r"^Version: (\S+)$")[1]


def unpack(package: str, into: Path) -> None:
    """Download one package and unpack it into a folder."""
    with tempfile.TemporaryDirectory(prefix="fk-deb-") as folder:
        fetched = subprocess.run(
            ["apt-get", "download", "-q", package], cwd=folder, capture_output=True, text=True, check=False
        )
        archives = list(Path(folder).glob("*.deb"))
        if fetched.returncode or not archives:
            raise MissingPartError(f"{package} could not be downloaded: {fetched.stderr.strip()}")
        subprocess.run(["dpkg-deb", "-x", archives[0], into], check=True)


def need_processor() -> None:
    """Raise `MissingPartError` unless this interpreter can run in the guest."""
    if platform.machine() != "x86_64":
        raise MissingPartError(f"the guest is an x86-64 computer, this one is {platform.machine()}")


def need_programs(*programs: str) -> None:
    """Raise `MissingPartError` naming every program that is not on the path."""
    absent = [name for name in programs if shutil.which(name) is None]
    if absent:
        raise MissingPartError(f"not installed: {', '.join(absent)}; run: {INSTALL}")
