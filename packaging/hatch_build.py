"""Build hook: the commit in wheels and source archives; man pages, and what completes commands in shells."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
from click.shell_completion import BashComplete, FishComplete, ZshComplete
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMPLETIONS = {
    BashComplete: "bash-completion/completions/fieldkit",
    ZshComplete: "zsh/site-functions/_fieldkit",
    FishComplete: "fish/vendor_completions.d/fieldkit.fish",
}
"""Where shells look for what completes a program's words, below ``share``."""


class BuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Adds files that are made from the checkout or its commands and stand in no folder of the source."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before it collects the files; an editable installation needs none of them."""
        if version == "editable":
            return
        self._folder = tempfile.TemporaryDirectory()
        if commit := _commit_of(Path(self.root)):
            build_data["force_include"][self._write("commit.txt", f"{commit}\n")] = "fieldkit/commit.txt"
        if self.target_name == "wheel":
            for shell, place in COMPLETIONS.items():
                script = shell(click.Group(), {}, "fieldkit", "_FIELDKIT_COMPLETE").source()
                build_data["shared_data"][self._write(shell.name, script)] = f"share/{place}"
            for name, page in _man_pages(self.root).items():
                build_data["shared_data"][self._write(name, page)] = f"share/man/man1/{name}"

    def _write(self, name: str, text: str) -> str:
        path = Path(self._folder.name) / name
        path.write_text(text, encoding="utf-8")
        return str(path)


def _man_pages(root: str) -> dict[str, str]:
    sys.path[:0] = [root, f"{root}/packaging"]
    from man_pages import man_pages

    return man_pages()


def _commit_of(root: Path) -> str | None:
    """The commit of the checkout at `root`; None in a source archive, which has its stamp, or without git."""
    if not (root / ".git").exists():  # the source may lie in another project's checkout
        return None
    words = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
