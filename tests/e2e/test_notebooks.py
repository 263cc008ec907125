"""The tutorial's notebooks run as they stand, each in an empty folder, and show what they say."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("xarray")

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "tutorial" / "notebooks"


@pytest.fixture
def printed_by(tmp_path, monkeypatch):
    """What a notebook prints, all cells together."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))

    def run(name: str) -> str:
        (tmp_path / "work").mkdir()
        notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
        place = {"metadata": {"path": str(tmp_path / "work")}}
        nbclient.NotebookClient(notebook, timeout=500, resources=place).execute()
        outputs = (output for cell in notebook.cells for output in cell.get("outputs", ()))
        return "\n".join(output.get("text", "") for output in outputs)

    return run


def test_open_a_session(printed_by):
    printed = printed_by("open-a-session.ipynb")
    found = re.search(r"estimated again: (\S+) degrees", printed)
    assert found is not None
    assert float(found[1]) <= 1e-9


def test_calibrate_and_re_estimate(printed_by):
    printed = printed_by("calibrate-and-re-estimate.ipynb")
    found = re.search(r"beds without a say: (\S+) -> (\S+) degrees", printed)
    assert found is not None
    before, after = map(float, found.groups())
    assert after < before / 2
    assert "best median |error|" in printed


def test_write_a_driver(printed_by):
    assert "LUX 980" in printed_by("write-a-driver.ipynb")


def test_notebooks_are_kept_without_what_they_print():
    for path in NOTEBOOKS.glob("*.ipynb"):
        notebook = nbformat.read(path, as_version=4)
        assert not any(cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells), (
            path.name
        )
