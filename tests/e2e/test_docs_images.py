"""The images of the documentation come from its scripts, are small, and are shown on its pages."""

import re
from pathlib import Path

import pytest

from tests.e2e.test_docs import ROOT, loaded

DOCS = ROOT / "docs"
IMAGES = DOCS / "images"
KINDS = {".svg", ".png"}
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


def test_every_image_is_made_by_a_script(made):
    assert {path.name for path in stored()} == made


def test_every_image_is_shown_and_described():
    pages = "".join(path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md"))
    shown = {Path(file).name: words for words, file in re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", pages)}
    assert {path.name for path in stored()} == set(shown)
    assert all(len(words.split()) > 3 for words in shown.values())
