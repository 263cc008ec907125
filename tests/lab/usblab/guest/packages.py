"""Distribution packages, fetched by name and unpacked; nothing is installed and no root is needed."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from usblab.guest.missing import INSTALL, MissingPartError

USERLAND = ("udev", "busybox-static", "libusb-1.0-0")


def _ask(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise MissingPartError(f"`{' '.join(command)}` failed ({error}); run: {INSTALL}") from error


def kernel_package() -> str:
    """The concrete kernel package behind ``linux-image-amd64``; it changes with every security update."""
    depends = _ask("apt-cache", "depends", "linux-image-amd64")
    found = re.search(r"Depends: (linux-image-\S+)", depends)
    if found is None:
        raise MissingPartError(f"the package lists know no linux-image-amd64; run: {INSTALL}")
    return found[1]


def version(package: str) -> str:
    """The version the package lists offer."""
    found = re.search(
        r"^Version: (\S+)$", _ask("apt-cache", "show", "--no-all-versions", package), re.MULTILINE
    )
    if found is None:
        raise MissingPartError(f"the package lists know no {package}; run: {INSTALL}")
    return found[1]


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
