"""The guest's first file system: modules, the switch to the root image, and the code under test."""

from __future__ import annotations

import compileall
import py_compile
import shutil
import sys
import tempfile
from pathlib import Path

from usblab.guest.cpio import Archive
from usblab.guest.image import SITE_PACKAGES
from usblab.guest.kernel import Kernel

LAB = Path(__file__).resolve().parents[2]
PROJECT = LAB.parents[1]
SCRIPT = """#!/opt/fieldkit/bin/python
import sys
from fieldkit.cli import main
sys.exit(main())
"""


def build(kernel: Kernel) -> bytes:
    """The archive for this kernel with the project as it stands now."""
    archive = Archive()
    archive.folder("dev")
    archive.character_device("dev/console", 5, 1)
    archive.file("busybox", kernel.busybox.read_bytes(), 0o755)
    archive.file("init", (LAB / "usblab/inside/init.sh").read_bytes(), 0o755)
    archive.file("modules/order", "\n".join(module.name for module in kernel.modules).encode())
    for module in kernel.modules:
        archive.file(f"modules/{module.name}", module.read_bytes())
    _add_lab(archive)
    _add_fieldkit(archive)
    return archive.bytes()


def add_package(archive: Archive, source: Path, into: str) -> None:
    """A package with bytecode, so that the slow processor need not compile it."""
    with tempfile.TemporaryDirectory(prefix="fk-package-") as folder:
        copy = Path(folder, source.name)
        shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__"))
        compileall.compile_dir(copy, quiet=2, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
        archive.tree(copy, f"{into}/{source.name}")


def _add_lab(archive: Archive) -> None:
    archive.file("layer/lab/start.sh", (LAB / "usblab/inside/start.sh").read_bytes())
    archive.file("layer/lab/usblab/__init__.py", b"")
    add_package(archive, LAB / "usblab/inside", "layer/lab/usblab")


def _add_fieldkit(archive: Archive) -> None:
    """What installing the wheel would put there: the package with its linked folders, script, metadata."""
    add_package(archive, PROJECT / "fieldkit", f"layer/{SITE_PACKAGES}")
    archive.file("layer/opt/fieldkit/bin/fieldkit", SCRIPT.encode(), 0o755)
    installed = next(Path(entry) for entry in sys.path if list(Path(entry).glob("fieldkit-*.dist-info")))
    metadata = next(installed.glob("fieldkit-*.dist-info"))
    for name in ("METADATA", "entry_points.txt"):
        archive.file(f"layer/{SITE_PACKAGES}/{metadata.name}/{name}", (metadata / name).read_bytes())
    rules = PROJECT / "udev/70-fieldkit.rules"
    if rules.exists():
        archive.file("layer/etc/udev/rules.d/70-fieldkit.rules", rules.read_bytes())
