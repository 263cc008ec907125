"""The program under test: what of it goes into the guest, and how it is run there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Program:
    """An installed Python program to be tried against the drivers of the guest's kernel.

    `distribution` is its name for pip, whose declared dependencies the guest gets; an undeclared import
    fails there. `package` is the folder of its sources as they are now, links followed. `entry` is the
    function of its command, ``module:name``; the command is called like the package.

    `helpers` is a folder of functions for tests to call in the guest; it becomes a package of its name.
    `warm_up` is one of them, called with `warm_up_arguments` before the command first runs, to import what
    it needs. `files` are more files of the guest by absolute path, such as udev rules; `links` are folders
    below /dev with the stable names those rules make.
    """

    distribution: str
    package: Path
    entry: str
    helpers: Path | None = None
    warm_up: str = ""
    warm_up_arguments: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    links: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """The command's name."""
        return self.package.name
