"""The guest's root file system: interpreter, declared dependencies, udev, in one squashfs file.

The program under test itself is in the initramfs, so that an edited source file needs no new image. What is
copied from site-packages follows its declared dependencies only: an undeclared import fails in the guest.
"""

from __future__ import annotations

import hashlib
import importlib.metadata as metadata
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from packaging.requirements import Requirement

from usblab.guest import packages
from usblab.guest.missing import MissingPartError

PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"
VENV = "opt/venv"
SITE_PACKAGES = f"{VENV}/lib/{PYTHON}/site-packages"
LIBRARIES = "usr/lib/x86_64-linux-gnu"
NOT_NEEDED = shutil.ignore_patterns(  # tkinter asks for libraries that small installations lack
    "test", "tests", "idlelib", "ensurepip", "lib2to3", "tkinter", "turtledemo", "_tkinter.*",
    "site-packages", "config-*", "*.a",
)  # fmt: skip
ACCOUNTS = {"root": 0, "observer": 1000, "stranger": 1001}
GROUPS = {
    "root": 0, "tty": 5, "disk": 6, "lp": 7, "kmem": 15, "dialout": 20, "cdrom": 24, "tape": 26, "audio": 29,
    "video": 44, "plugdev": 46, "input": 101, "kvm": 102, "render": 103, "sgx": 104,
    "observer": 1000, "stranger": 1001,
}  # fmt: skip
EMPTY = ("proc", "sys", "dev", "run", "tmp", "root", "home")
OBSERVER_IN = ("dialout", "video", "plugdev")


def prepare(cache: Path, distribution: str) -> Path:
    """The root image for this interpreter, these libraries and these packages; built if there is none."""
    image = cache / f"root-{_key(distribution)}.squashfs"
    if not image.exists():
        for old in cache.glob("root-*.squashfs"):
            old.unlink()
        _build(image, distribution)
    return image


def distributions(root: str) -> dict[str, metadata.Distribution]:
    """What `root` declares to need, with what those need in turn, without extras and without itself."""
    found: dict[str, metadata.Distribution] = {}
    waiting = [root]
    while waiting:
        distribution = metadata.distribution(waiting.pop())
        for text in distribution.requires or ():
            need = Requirement(text)
            if (need.marker is None or need.marker.evaluate({"extra": ""})) and need.name not in found:
                found[need.name] = metadata.distribution(need.name)
                waiting.append(need.name)
    return found


def _key(distribution: str) -> str:
    libraries = sorted(f"{name}={d.version}" for name, d in distributions(distribution).items())
    userland = [f"{name}={packages.version(name)}" for name in packages.USERLAND]
    parts = [sys.version, *libraries, *userland, Path(__file__).read_text()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def _build(image: Path, distribution: str) -> None:
    packages.need_programs("mksquashfs")
    with tempfile.TemporaryDirectory(prefix="fk-root-", dir=image.parent) as folder:
        root = Path(folder, "root")
        _skeleton(root)
        _userland(root, Path(folder, "packages"))
        _python(root, distribution)
        _shared_libraries(root)
        half = Path(folder, "half.squashfs")
        options = ["-all-root", "-comp", "zstd", "-Xcompression-level", "3", "-quiet", "-no-progress"]
        subprocess.run(["mksquashfs", root, half, *options], check=True, stdout=subprocess.DEVNULL)
        half.rename(image)


def _skeleton(root: Path) -> None:
    for folder in ("usr/bin", "usr/sbin", "usr/lib64", LIBRARIES, "etc/udev/rules.d", *EMPTY):
        (root / folder).mkdir(parents=True)
    for name in ("bin", "sbin", "lib", "lib64"):
        (root / name).symlink_to(f"usr/{name}")
    homes = {name: "root" if uid == 0 else f"home/{name}" for name, uid in ACCOUNTS.items()}
    accounts = [f"{name}:x:{uid}:{uid}::/{homes[name]}:/bin/sh\n" for name, uid in ACCOUNTS.items()]
    groups = [f"{name}:x:{gid}:{'observer' * (name in OBSERVER_IN)}\n" for name, gid in GROUPS.items()]
    (root / "etc/passwd").write_text("".join(accounts))
    (root / "etc/group").write_text("".join(groups))
    (root / "etc/nsswitch.conf").write_text("passwd: files\ngroup: files\n")
    (root / "etc/ld.so.conf").write_text(f"/{LIBRARIES}\n")


def _userland(root: Path, unpacked: Path) -> None:
    for name in packages.USERLAND:
        packages.unpack(name, unpacked)
    shutil.copytree(unpacked / "lib/udev", root / "usr/lib/udev", ignore=shutil.ignore_patterns("hwdb.d"))
    (root / "usr/lib/udev/systemd-udevd").symlink_to("/usr/bin/udevadm")  # one program, two names
    for program in ("udevadm", "busybox"):
        shutil.copy(unpacked / "bin" / program, root / "usr/bin" / program)
    shutil.copy(next(unpacked.rglob("libusb-1.0.so.0.*")), root / LIBRARIES / "libusb-1.0.so.0")
    shutil.copy("/sbin/ldconfig", root / "usr/sbin/ldconfig")
    zones = Path("/usr/share/zoneinfo")
    if zones.exists():
        shutil.copytree(zones, root / "usr/share/zoneinfo", ignore=shutil.ignore_patterns("right", "posix"))


def _python(root: Path, program: str) -> None:
    """A relocated interpreter with a virtual environment, so that no path or variable is special."""
    home, venv = root / "opt/python", root / VENV
    (home / "bin").mkdir(parents=True)
    shutil.copy(Path(sys.executable).resolve(), home / "bin" / PYTHON)
    shutil.copytree(sysconfig.get_path("stdlib"), home / "lib" / PYTHON, ignore=NOT_NEEDED, symlinks=False)
    (venv / "bin").mkdir(parents=True)
    (venv / "bin/python").symlink_to(f"/opt/python/bin/{PYTHON}")
    (venv / "pyvenv.cfg").write_text("home = /opt/python/bin\ninclude-system-site-packages = false\n")
    for distribution in distributions(program).values():
        _copy_distribution(distribution, root / SITE_PACKAGES)


def _copy_distribution(distribution: metadata.Distribution, into: Path) -> None:
    for entry in distribution.files or ():
        source = Path(str(distribution.locate_file(entry)))
        if ".." in entry.parts or {"tests", "test"} & set(entry.parts[2:]) or not source.is_file():
            continue
        target = into / entry
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(source, target)  # with its date, which the bytecode beside it is checked against


def _shared_libraries(root: Path) -> None:
    """Every library a program or module of the tree is linked against and the tree does not bring itself."""
    programs = [p for p in root.rglob("*") if p.is_file() and not p.is_symlink() and _is_dynamic(p)]
    environment = os.environ | {"LD_LIBRARY_PATH": sysconfig.get_config_var("LIBDIR") or ""}
    listing = subprocess.run(
        ["ldd", *programs], env=environment, capture_output=True, text=True, check=False
    ).stdout
    brought = {program.name for program in programs}
    for line in set(listing.splitlines()):
        name, _, rest = line.strip().partition(" => ")
        if rest.startswith("not found") and name in brought:
            continue  # a wheel's own library, found by the path its user carries
        if rest.startswith("not found"):
            raise MissingPartError(f"the guest needs {name}, which this computer lacks")
        path = Path((rest or name).split(" (")[0])
        if path.is_absolute() and not path.is_relative_to(root) and path.is_file():
            folder = "usr/lib64" if path.name.startswith("ld-linux") else LIBRARIES
            shutil.copy(path, root / folder / path.name)


def _is_dynamic(path: Path) -> bool:
    if not (".so" in path.name or os.access(path, os.X_OK)):
        return False
    with path.open("rb") as file:
        return file.read(4) == b"\x7fELF"
