"""The images of the documentation come from its scripts, are small, and are shown on its pages."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.e2e.test_docs import ROOT, loaded

DOCS = ROOT / "docs"
IMAGES = DOCS / "images"
KINDS = {".svg", ".png"}
LARGEST = {".png": 150_000, ".svg": 200_000}
"""Bytes; a terminal's SVG compresses to a tenth."""
ALL_TOGETHER = 4_000_000
OF_HOURS = {"reliability.svg", "ranks.svg"}
"""Of `docs/accuracy.py` and `docs/ranks.py`, which take hours."""


@pytest.fixture
def made(monkeypatch):
    """Names of the images that the scripts make."""
    monkeypatch.syspath_prepend(str(IMAGES))
    make = loaded("images/make")
    of_scripts = {image for name in make.scripts() for image in make.script(name).IMAGES}
    return {*of_scripts, *OF_HOURS}


def stored():
    return {path for path in IMAGES.iterdir() if path.suffix in KINDS}


def words(image: Path) -> list[str]:
    """The words of an SVG image without its numbers, which move with every change of an estimator."""
    text = re.findall(r"<text[^>]*>([^<]*[a-z][^<]*)</text>", image.read_text(encoding="utf-8"))
    return [re.sub(r"[\d.,: ]+", "#", line) for line in text]


def test_every_image_is_made_by_a_script(made):
    assert {path.name for path in stored()} == made


def test_images_are_small():
    sizes = {path: path.stat().st_size for path in stored()}
    assert [path.name for path, size in sizes.items() if size > LARGEST[path.suffix]] == []
    assert sum(sizes.values()) < ALL_TOGETHER


def test_every_image_is_shown_and_described():
    pages = "".join(path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md"))
    shown = {Path(file).name: words for words, file in re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", pages)}
    assert {path.name for path in stored()} == set(shown)
    assert all(len(words.split()) > 3 for words in shown.values())


@pytest.mark.slow
def test_images_made_anew_show_the_same(made, tmp_path):
    subprocess.run([sys.executable, IMAGES / "make.py", "--into", tmp_path], check=True, cwd=ROOT)
    assert {path.name for path in tmp_path.iterdir()} == made - OF_HOURS
    for image in tmp_path.glob("*.svg"):
        assert words(image) == words(IMAGES / image.name), image.name
