"""Two short recordings on simulated devices, of different sand, and a cache of their own."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.harness.command_line import succeed
from tests.harness.once import made_once
from tests.harness.seldom import SET_SELDOM


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_of_both(tmp_path_factory, tmp_path_factory.mktemp("campaign"))


def copy_of_both(factory: pytest.TempPathFactory, folder: Path) -> Path:
    """The campaign with both, in a folder."""
    return shutil.copytree(made_once(factory, "two-sessions", record), folder, dirs_exist_ok=True)


def record(folder: Path) -> None:
    succeed("init", "--simulated", folder)
    for seed in (1, 2):
        settings = ["simulation.speed=max", f"simulation.seed={seed}", f"simulation.albedo=0.2{seed}"]
        words = ("record", "-C", folder, "--for", "11m", "--name", f"s{seed}", "-q", *SET_SELDOM)
        succeed(*words, *(word for setting in settings for word in ("--set", setting)))


@pytest.fixture
def sessions(folder: Path) -> list[Path]:
    return sorted((folder / "recordings").glob("*.h5"))


@pytest.fixture
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "fieldkit" / "estimates"
