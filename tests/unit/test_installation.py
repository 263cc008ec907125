"""No text sends a user to the package index for another project's package ``fieldkit``."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from fieldkit.model.installation import DISTRIBUTION, install_extra
from fieldkit.recording.doctor import doctor

ROOT = Path(__file__).parents[2]
OTHER = r"(?<![\w./-])fieldkit(?![\w-]|\.(?!\s))"
STRANGER = re.compile(
    rf"\b(?:pip|pipx|uv|conda|mamba)\b[^`]*\b(?:install|add|run|upgrade)\s+(?:-\S+\s+)*[\"']*{OTHER}"
    rf"|\b(?:uvx|install|--upgrade|-U)\s+[\"'`]*{OTHER}|{OTHER}(?:\[[a-z]|[=~><]=|\s@\s)"
    r"|\bfieldkit-[\d*]\S*(?:whl|tar)"
)


def texts() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listing.returncode:
        pytest.skip("this is not a checkout")
    return [ROOT / name for name in listing.stdout.split("\0") if name and (ROOT / name).is_file()]


def test_every_text_that_names_an_installation_means_this_distribution() -> None:
    lines = {
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:120]}"
        for path in texts()
        if path != Path(__file__)
        for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1)
        if STRANGER.search(line)
    }
    assert lines == set()


@pytest.mark.parametrize(
    "line",
    [
        "python -m pip install -U 'fieldkit[lab]'",
        "pipx install --quiet fieldkit",
        "uvx fieldkit demo",
        "install fieldkit 0.3.0 there",
        "pip install fieldkit-0.3.0-py3-none-any.whl",
    ],
)
def test_a_line_about_the_other_package_is_noticed(line: str) -> None:
    assert STRANGER.search(line)
    assert not STRANGER.search(line.replace("fieldkit", "fieldkit_slope" if "whl" in line else DISTRIBUTION))


def test_an_extra_is_one_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["name"] == DISTRIBUTION
    sources = [path for room in ("fieldkit", "drivers", "sessions") for path in (ROOT / room).rglob("*.py")]
    named = {
        extra
        for path in sources
        for extra in re.findall(r"install_extra\([\"'](\w+)[\"']\)", path.read_text(encoding="utf-8"))
    }
    assert named <= set(project["optional-dependencies"])
    assert install_extra("lab") == "pip install 'fieldkit-slope[lab]'"


def test_doctor_reports_the_other_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Metadata as an installer leaves it (PEP 376)."""
    metadata = tmp_path / "fieldkit-0.34.1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: fieldkit\nVersion: 0.34.1\n")
    assert "fail" not in {check.level for check in doctor(tmp_path) if check.what == "program"}
    monkeypatch.syspath_prepend(tmp_path)
    (problem,) = [check for check in doctor(tmp_path) if (check.what, check.level) == ("program", "fail")]
    assert "0.34.1" in problem.text
    assert "uninstall fieldkit" in problem.fix
    assert DISTRIBUTION in problem.fix
