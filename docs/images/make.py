"""Make the images of the documentation, all of them or those of some scripts; some minutes.

    python docs/images/make.py [--into FOLDER] [SCRIPT ...]

Each script ``make_NAME.py`` beside this file lists the files that it writes in ``IMAGES``. A test compares
the lists with the folder.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

from demo_day import DemoDay  # noqa: E402


def scripts() -> list[str]:
    """Names of the scripts: ``home`` for ``make_home.py``."""
    return sorted(path.stem.removeprefix("make_") for path in HERE.glob("make_*.py"))


def script(name: str) -> ModuleType:
    """A script, imported."""
    return import_module(f"make_{name}")


def main(names: list[str], images: Path) -> None:
    """Run the scripts on one simulated day, and show what they wrote."""
    with tempfile.TemporaryDirectory() as folder:
        day = DemoDay(Path(folder), images)
        for name in names:
            script(name).main(day)
            for image in script(name).IMAGES:
                print(f"{image}  {(images / image).stat().st_size / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--into", type=Path, default=HERE)
    parser.add_argument("scripts", nargs="*", metavar="SCRIPT")
    asked = parser.parse_args()
    main(asked.scripts or scripts(), asked.into)
