"""Archives in the kernel's initramfs format (cpio "newc"), written without root and without cpio.

Layout: Linux kernel documentation, "initramfs buffer format".
"""

from __future__ import annotations

import os
import stat
from pathlib import Path


class Archive:
    """An initramfs in the making; every entry belongs to root and is dated 1970."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._known: set[str] = set()

    def folder(self, name: str) -> None:
        """A folder, with those above it; adding it again does nothing."""
        if name in ("", ".") or name in self._known:
            return
        self.folder(str(Path(name).parent))
        self._entry(name, stat.S_IFDIR | 0o755)

    def file(self, name: str, content: bytes, mode: int = 0o644) -> None:
        """A regular file."""
        self.folder(str(Path(name).parent))
        self._entry(name, stat.S_IFREG | mode, content)

    def link(self, name: str, target: str) -> None:
        """A symbolic link."""
        self.folder(str(Path(name).parent))
        self._entry(name, stat.S_IFLNK | 0o777, target.encode())

    def character_device(self, name: str, major: int, minor: int) -> None:
        """A device node, which an unprivileged `mknod` could not make."""
        self.folder(str(Path(name).parent))
        self._entry(name, stat.S_IFCHR | 0o600, device=(major, minor))

    def tree(self, source: Path, name: str) -> None:
        """All files below a folder; links are followed."""
        for folder, _, files in os.walk(source, followlinks=True):
            for file in sorted(files):
                path = Path(folder, file)
                self.file(f"{name}/{path.relative_to(source)}", path.read_bytes())

    def bytes(self) -> bytes:
        """The finished archive."""
        trailer = _header("TRAILER!!!", 0, 0, 0, (0, 0))
        return b"".join((*self._parts, trailer))

    def _entry(self, name: str, mode: int, content: bytes = b"", device: tuple[int, int] = (0, 0)) -> None:
        self._known.add(name)
        self._parts += [_header(name, len(self._known), mode, len(content), device), _padded(content)]


def _header(name: str, inode: int, mode: int, size: int, device: tuple[int, int]) -> bytes:
    links = 2 if stat.S_ISDIR(mode) else 1
    fields = (inode, mode, 0, 0, links, 0, size, 0, 0, *device, len(name) + 1, 0)
    return _padded(b"070701" + b"".join(b"%08x" % field for field in fields) + name.encode() + b"\0")


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
