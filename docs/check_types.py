"""Check the Python of pages and notebooks with pyright, strict, and that the types of fieldkit are declared.

All blocks of a page are one module, but for those with a file's name, and so are all cells of a notebook.
``make lint`` runs it:
``python docs/check_types.py``.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"(?ms)^```py(?:thon)?(?: title=\"(\S+)\.py\")?\n(.*?)^```")
UNTYPED = ("usb-lab.md", "session-file.md")
"""Pages that show part of a test, or a library without types, which `tests/e2e/test_ecosystem.py` runs."""
OPTIONS = {
    "typeCheckingMode": "strict",
    "pythonVersion": "3.11",
    "extraPaths": [str(ROOT)],
    # pandas takes any type in places, matplotlib any further keyword: their methods are partly unknown
    "reportUnknownMemberType": False,
    # the last line of a cell is what it shows
    "reportUnusedExpression": False,
}

COMPLETE = 0.99
"""Share of fieldkit's public names whose type is declared, not inferred: what users of the package get."""


def modules() -> Iterator[tuple[str, str]]:
    """Name and Python of each notebook, of each page that has any, and of each example."""
    for path in sorted((ROOT / "docs").rglob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        yield (
            module_name(path),
            "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"),
        )
    pages = (path for folder in ("docs", "examples") for path in sorted((ROOT / folder).rglob("*.md")))
    for path in (ROOT / "README.md", *pages):
        blocks = BLOCK.findall(path.read_text(encoding="utf-8"))
        if blocks and path.name not in UNTYPED:
            yield from ((title, block) for title, block in blocks if title)
            yield module_name(path), "\n\n".join(block for title, block in blocks if not title)
    for path in sorted((ROOT / "examples").rglob("*.py")):
        yield module_name(path), path.read_text(encoding="utf-8")


def module_name(path: Path) -> str:
    """The path within the project as one name."""
    return re.sub(r"\W", "_", str(path.relative_to(ROOT)))


def completeness() -> float:
    """Share of public names of this checkout with a known type, as pyright counts them."""
    options = ["--verifytypes", "fieldkit", "--ignoreexternal", "--outputjson"]
    # for this pyright takes the first python of the path, whatever it is given
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [sys.executable, "-m", "pyright", *options],
        check=False,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
    )
    return float(json.loads(done.stdout)["typeCompleteness"]["completenessScore"])


def main() -> int:
    """Check the types of fieldkit and of what its pages show; the exit code."""
    share = completeness()
    print(f"{share:.1%} of fieldkit's public names have a declared type, {COMPLETE:.0%} needed")
    return check_pages() or int(share < COMPLETE)


def check_pages() -> int:
    """Write the modules into a folder and check it; pyright's exit code."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pyrightconfig.json").write_text(json.dumps(OPTIONS), encoding="utf-8")
        for name, code in modules():
            (Path(folder) / f"{name}.py").write_text(code + "\n", encoding="utf-8")
        command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--project", folder]
        return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
