"""The guest's first file system: modules, the switch to the root image, and the code under test."""

from __future__ import annotations

import compileall
import py_compile
import shutil
import sys
import tempfile
from pathlib import Path

from usblab.guest.cpio import Archive
from usblab.guest.image import SITE_PACKAGES, VENV
from usblab.guest.kernel import Kernel
from usblab.program import Program

INSIDE = Path(__file__).resolve().parents[1] / "inside"
SCRIPT = """#!/{venv}/bin/python
import sys
from {module} import {name}
sys.exit({name}())
"""


def build(kernel: Kernel, program: Program) -> bytes:
    """The archive for this kernel with the program as it stands now."""
    archive = Archive()
    archive.folder("dev")
    archive.character_device("dev/console", 5, 1)
    archive.file("busybox", kernel.busybox.read_bytes(), 0o755)
    archive.file("init", (INSIDE / "init.sh").read_bytes(), 0o755)
    archive.file("modules/order", "\n".join(module.name for module in kernel.modules).encode())
    for module in kernel.modules:
        archive.file(f"modules/{module.name}", module.read_bytes())
    _add_lab(archive, program)
    _add_program(archive, program)
    return archive.bytes()


def add_package(archive: Archive, source: Path, into: str) -> None:
    """A package with bytecode, so that the slow processor need not compile it."""
    with tempfile.TemporaryDirectory(prefix="fk-package-") as folder:
        copy = Path(folder, source.name)
        shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__"))
        compileall.compile_dir(copy, quiet=2, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
        archive.tree(copy, f"{into}/{source.name}")


def _add_lab(archive: Archive, program: Program) -> None:
    archive.file("layer/lab/start.sh", (INSIDE / "start.sh").read_bytes())
    archive.file("layer/lab/usblab/__init__.py", b"")
    add_package(archive, INSIDE, "layer/lab/usblab")
    if program.helpers is not None:
        add_package(archive, program.helpers, "layer/lab")


def _add_program(archive: Archive, program: Program) -> None:
    """What installing its wheel would put there (package, script, metadata), and its other files."""
    add_package(archive, program.package, f"layer/{SITE_PACKAGES}")
    module, _, name = program.entry.partition(":")
    script = SCRIPT.format(venv=VENV, module=module, name=name)
    archive.file(f"layer/{VENV}/bin/{program.command}", script.encode(), 0o755)
    pattern = f"{program.distribution.replace('-', '_')}-*.dist-info"  # the escaped name of its metadata
    metadata = next(found for entry in sys.path for found in Path(entry).glob(pattern))
    for file in ("METADATA", "entry_points.txt"):
        archive.file(f"layer/{SITE_PACKAGES}/{metadata.name}/{file}", (metadata / file).read_bytes())
    for path, content in program.files.items():
        archive.file(f"layer{path}", content)
