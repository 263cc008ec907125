"""Places of errors are data: no problem begins with a file, a key or a stream and a colon."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PRODUCT = ("fieldkit", "drivers", "sessions", "calibration")
WITH_PLACE = re.compile(r"""Error\(\s*f["']\{[^{}]+\}: """)


def test_no_problem_begins_with_its_place():
    files = [path for name in PRODUCT for path in (ROOT / name).rglob("*.py")]
    assert len(files) > 300
    places = [
        f"{file.relative_to(ROOT)}: {found[0]}"
        for file in files
        for found in WITH_PLACE.finditer(file.read_text(encoding="utf-8"))
    ]
    assert places == []
