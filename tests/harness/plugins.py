"""Drivers of other packages, laid down as pip would."""

from __future__ import annotations

from pathlib import Path


def install(folder: Path, package: str, name: str, target: str = "json:JSONDecoder") -> None:
    """The records of a package whose driver `name` is at `target`, in a folder that Python imports from."""
    info = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[fieldkit.drivers]\n{name} = {target}\n")
