"""What packages and citations state about fieldkit agrees with the code."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import fieldkit

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["codemeta.json", ".zenodo.json"])
def test_metadata_is_of_this_version_and_these_keywords(name: str):
    stated = json.loads((ROOT / name).read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (stated["version"], stated["keywords"]) == (fieldkit.__version__, project["keywords"])


def test_the_citation_is_of_this_version():
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {fieldkit.__version__}\n" in cited


def test_the_changelog_has_this_version():
    assert f"\n## {fieldkit.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_reference_of_the_paper_is_in_its_bibliography_and_the_other_way_round():
    folder = ROOT / "docs/paper"
    cited = set(re.findall(r"(?<![\w.])@(\w+)", (folder / "paper.md").read_text(encoding="utf-8")))
    listed = set(re.findall(r"(?m)^@\w+\{(\w+),", (folder / "paper.bib").read_text(encoding="utf-8")))
    assert cited == listed


def wheel_of(folder: Path) -> Path:
    """A wheel of the project, built in isolation and dated as its archives are."""
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--wheel-dir",
        str(folder),
        str(ROOT),
    ]
    subprocess.run(command, check=True, env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}, timeout=600)
    return next(folder.glob("fieldkit-*.whl"))


@pytest.mark.slow
def test_a_wheel_built_again_is_equal_and_holds_the_whole_package(tmp_path: Path):
    first, again = wheel_of(tmp_path / "first"), wheel_of(tmp_path / "again")
    assert first.read_bytes() == again.read_bytes()
    package = ROOT / "fieldkit"
    linked = [package / room for room in ("calibration", "drivers", "sessions")]
    files = {file.relative_to(ROOT) for room in (package, *linked) for file in room.rglob("*.py")}
    assert {str(file) for file in files} <= set(zipfile.ZipFile(first).namelist())
