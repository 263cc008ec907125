"""One simulated afternoon for every image of the documentation, and how its screens become image files."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image
from rich.console import Console, RenderableType
from rich.terminal_theme import SVG_EXPORT_THEME
from rich.text import Text

from fieldkit.views.screen import THEMES

if TYPE_CHECKING:
    from playwright.sync_api import Page

COLUMNS = 100
SHADES = 256
"""Colours of an image file, which needs a third of the bytes of true colour."""


@dataclass
class DemoDay:
    """A folder in which the campaigns of the images are recorded, each when it is first asked for."""

    folder: Path
    images: Path
    """Where the images go."""

    @cached_property
    def demo(self) -> Path:
        """The campaign of ``fieldkit demo``: three hours, and their report."""
        self.run("demo")
        return self.folder / "demo"

    @property
    def session(self) -> Path:
        """The demo's session."""
        return next((self.demo / "recordings").glob("*.h5"))

    @cached_property
    def sandslope(self) -> Path:
        """A campaign on simulated devices: an hour, and twenty minutes in which the camera is unplugged."""
        folder = self.folder / "sandslope"
        self.run("init", "--simulated", "sandslope", "-q")
        for name, length, fault in (("clear", "1h", "[]"), ("cable", "20m", '["cable"]')):
            record = ("record", "--for", length, "--name", name, "--set", "simulation.speed=max")
            self.run(*record, "--set", f"simulation.faults={fault}", within=folder)
        return folder

    def run(self, *words: str, within: Path | None = None) -> str:
        """What a command prints on standard output, as on a terminal of `COLUMNS`."""
        environment = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": str(COLUMNS)}
        command = [sys.executable, "-m", "fieldkit", *words]
        done = subprocess.run(
            command, cwd=within or self.folder, env=environment, check=False, text=True,
            capture_output=True,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{' '.join(words)}\n{done.stderr}")
        return done.stdout

    def write_png(self, source: Path, name: str, width: int) -> None:
        """An image in few colours and no wider than `width`, so that its file is small."""
        image = Image.open(source).convert("RGB")
        if image.width > width:
            image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
        few = image.quantize(SHADES, dither=Image.Dither.NONE)
        few.save(self.images / f"{name}.png", optimize=True)


def terminal_svg(shown: RenderableType, title: str, rows: int | None = None) -> str:
    """A terminal of `COLUMNS` as SVG, with the reader's own monospaced font."""
    console = Console(
        record=True,
        width=COLUMNS,
        height=rows,
        file=io.StringIO(),
        force_terminal=True,
        color_system="truecolor",
        theme=THEMES["dark"],
    )
    console.print(shown)
    svg = console.export_svg(title=title, theme=SVG_EXPORT_THEME, unique_id=re.sub(r"\W", "-", title))
    svg = re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL)  # nothing is fetched from outside
    return re.sub(r"[ \t]+$", "", svg.replace("Fira Code, monospace", "monospace"), flags=re.MULTILINE)


def command_svg(command: str, printed: str) -> str:
    """A command after a prompt, and what it printed."""
    return terminal_svg(Text.assemble(f"$ {command}\n", Text.from_ansi(printed.rstrip())), "fieldkit")


@contextmanager
def browser_page(width: int, height: int) -> Iterator[Page]:
    """A page of the system's Chromium, to take pictures of HTML files."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        yield browser.new_page(viewport={"width": width, "height": height})
        browser.close()
