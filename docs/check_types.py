"""Check the Python of pages and notebooks with pyright, strict: ``python docs/check_types.py``.

What a page shows together is one module, each cell of a notebook a part of one. Lines of a shell (``!``, ``%``) are
left out. Cells that end in an expression show it, as notebooks do.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"(?ms)^```python\n(.*?)^```")
SHELL = re.compile(r"(?m)^[!%]")
OPTIONS = {
    "typeCheckingMode": "strict",
    "pythonVersion": "3.11",
    "extraPaths": [str(ROOT)],
    "reportUnusedExpression": False,  # the last line of a cell is what it shows
}


def sources() -> Iterator[tuple[str, str]]:
    """Name and Python of each page and notebook that has any."""
    for path in sorted((ROOT / "docs").rglob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        yield path.stem, "\n\n".join("".join(one["source"]) for one in cells if one["cell_type"] == "code")
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").rglob("*.md"))]:
        if blocks := BLOCK.findall(path.read_text(encoding="utf-8")):
            yield path.stem, "\n\n".join(blocks)
    for path in sorted((ROOT / "examples").rglob("*.py")):
        yield path.stem, path.read_text(encoding="utf-8")


def main() -> int:
    """Write the modules into a folder and run pyright on it; its exit code."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pyrightconfig.json").write_text(json.dumps(OPTIONS), encoding="utf-8")
        for name, code in sources():
            module = Path(folder) / f"{name.replace('-', '_')}.py"
            module.write_text(SHELL.sub("# ", code) + "\n", encoding="utf-8")
        command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--project", folder]
        return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
