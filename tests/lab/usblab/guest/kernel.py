"""The kernel and the few modules the guest loads, taken out of the distribution's package."""

from __future__ import annotations

import lzma
import re
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from usblab.guest import packages

MODULES = (
    "virtio_pci", "virtio_blk", "virtio_console", "squashfs", "overlay",
    "xhci_pci", "ehci_pci", "uvcvideo", "ftdi_sio",
)  # fmt: skip
XZ_MAGIC = b"\xfd7zXZ\0"


@dataclass(frozen=True)
class Kernel:
    """An unpacked kernel to boot, the modules in the order to load them, and busybox to do it with."""

    image: Path
    busybox: Path
    modules: tuple[Path, ...]
    version: str


def prepare(cache: Path) -> Kernel:
    """The newest kernel of the distribution, unpacked once and kept under its version."""
    package, version = packages.kernel_package()
    home = cache / f"{package}_{version}"
    if not home.exists():
        for old in cache.glob("linux-image-*"):
            shutil.rmtree(old)
        _build(package, home)
    order = (home / "order").read_text().split()
    return Kernel(home / "vmlinux", home / "busybox", tuple(home / name for name in order), version)


def _build(package: str, home: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="fk-kernel-", dir=home.parent) as folder:
        tree, parts = Path(folder, "tree"), Path(folder, "parts")
        packages.unpack(package, tree)
        parts.mkdir()
        compressed = next((tree / "boot").glob("vmlinuz-*"))
        (parts / "vmlinux").write_bytes(decompress(compressed.read_bytes()))
        chosen = load_order(tree / "lib/modules", MODULES)
        for module in chosen:
            shutil.copy(module, parts)
        packages.unpack("busybox-static", tree)
        shutil.copy(tree / "bin/busybox", parts)
        (parts / "order").write_text("\n".join(module.name for module in chosen))
        parts.rename(home)


def decompress(image: bytes) -> bytes:
    """The ELF kernel inside a bzImage; booting it directly saves two seconds of emulated decompression."""
    start = image.index(XZ_MAGIC)
    return lzma.LZMADecompressor(format=lzma.FORMAT_XZ).decompress(image[start:])


def load_order(tree: Path, wanted: tuple[str, ...]) -> list[Path]:
    """The module files of `wanted` with everything they depend on, dependencies first.

    The dependencies are read from each module's own ``depends=`` entry, because ``depmod``
    has not run on a package that was only unpacked.
    """
    files = {_plain(path.name.removesuffix(".ko")): path for path in tree.rglob("*.ko")}
    order: list[Path] = []

    def add(name: str) -> None:
        path = files.get(_plain(name))
        if path is None or path in order:  # built into the kernel, or there already
            return
        for dependency in _depends(path.read_bytes()):
            add(dependency)
        order.append(path)

    for name in wanted:
        add(name)
    return order


def _depends(module: bytes) -> list[str]:
    found = re.search(rb"\0depends=([^\0]*)\0", module)
    return [name for name in found[1].decode().split(",") if name] if found else []


def _plain(name: str) -> str:
    return name.replace("-", "_")
