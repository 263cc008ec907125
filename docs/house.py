"""The house in numbers: how large the rooms are, how the files are cut, what is written twice.

``python docs/house.py [TREE ...]`` counts one checkout or several side by side and prints a Markdown table.
Nothing is imported or run; everything is read as text and syntax trees.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from statistics import median, quantiles

ROOMS = ("fieldkit", "drivers", "sessions", "calibration")
"""Folders with source; the last three are linked into the first."""

DIALECT = (
    r"bricks?|pictures?|beds?|lamps?|votes?|loud|swollen|warmth|stretch(es)?|verbs?|remarks?|notices?"
    r"|doubts?|answers?|told|tells?|said|heard|asking|questions?|turns?|feed|inbox|audience|onlooker|housekeeping"
    r"|findings?|look(_at|s)?|foreign|gathering|tally|keeper|material|causes|canvas|exchange|veils?|curves?|newest|meant"
)
"""Words that have a standard name instead. Some also have an honest use: the count need not reach zero."""

NOTIONS = {
    "a set of quality flags": r"UNUSABLE\w*\s*=|\w+ = \(?\s*Quality\.\w+ \| Quality\.\w+ \| Quality",
    "counts made kelvin": r"def frame_k\(|\binfo\.scale\s*\*|\*\s*info\.scale",
    "durations parsed": r"def _?(parse_)?duration\w*\(.*\bstr\b|\[hms\]",
    "files replaced as a whole": r"os\.replace\(|(?<!dataclasses)\.replace\((path|file|final|target)\)",
    "SHA-256 of a file": r"file_digest\(|sha256\(\w+\.read_bytes",
    "0 °C in kelvin": r"\b273\.15\b",
    "nanoseconds of a minute": r"=\s*60_?000_?000_?000\b|=\s*60 \* (SECOND_NS|1_000_000_000)",
    "nanoseconds of a second": r"=\s*1_000_000_000\b|=\s*10\*\*9\b",
}
"""What should have one home each, as a regular expression of its definition or of its value."""


def sources(tree: Path) -> list[Path]:
    """Every Python file of the program, each once (links are not followed)."""
    found = (file for room in ROOMS for file in (tree / room).rglob("*.py"))
    return sorted({file.resolve() for file in found if "/__pycache__/" not in str(file)})


def room_of(file: Path, tree: Path) -> str:
    """The room a file belongs to: ``drivers``, ``estimation``, ``cli`` ..."""
    parts = file.relative_to(tree).parts
    return parts[0] if parts[0] != "fieldkit" or len(parts) == 2 else parts[1]


def code_lines(file: Path) -> int:
    """Lines that are not blank."""
    return sum(1 for line in file.read_text(encoding="utf-8").splitlines() if line.strip())


def statement_lines(file: Path) -> int:
    """Lines with code: neither blank, nor docstring, nor comment alone."""
    text = file.read_text(encoding="utf-8")
    documented = (
        node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Expr) and is_text(node.value)
    )
    skipped = {line for node in documented for line in range(node.lineno, (node.end_lineno or 0) + 1)}
    return sum(
        1
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#") and number not in skipped
    )


def is_text(node: ast.expr) -> bool:
    """Whether an expression is a plain string, which as a statement documents what stands before it."""
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def module_name(file: Path, tree: Path) -> str:
    """The dotted name a module is imported by."""
    parts = file.relative_to(tree).with_suffix("").parts
    dotted = parts if parts[0] == "fieldkit" else ("fieldkit", *parts)
    return ".".join(dotted[:-1] if dotted[-1] == "__init__" else dotted)


def imported(file: Path) -> Iterator[str]:
    """Every dotted name that a file imports, at the top or inside a function."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def with_one_importer(tree: Path, files: Iterable[Path]) -> list[str]:
    """Modules that a single other one imports, from the same folder: candidates for being one idea."""
    names = {module_name(file, tree): file for file in files}
    importers: dict[str, set[str]] = defaultdict(set)
    for name, file in names.items():
        for target in imported(file):
            if target in names and target != name:
                importers[target].add(name)
    return sorted(
        name
        for name, users in importers.items()
        if len(users) == 1 and next(iter(users)).rpartition(".")[0] == name.rpartition(".")[0]
    )


def colliding(files: Iterable[Path]) -> int:
    """Names of modules in more than one room; a command and what it calls share theirs on purpose."""
    below_cli = [file for file in files if file.parent.name != "cli"]
    stems = Counter(file.stem for file in below_cli if not file.stem.startswith("__"))
    return sum(1 for count in stems.values() if count > 1)


def dialect(files: Iterable[Path]) -> tuple[int, int]:
    """Old words in identifiers (parts between underscores and capitals), and in docstrings and messages."""
    words = re.compile(rf"^(?:{DIALECT})$", re.IGNORECASE)
    in_names = in_prose = 0
    for file in files:
        for token in tokenize.generate_tokens(io.StringIO(file.read_text(encoding="utf-8")).readline):
            if token.type == tokenize.NAME:
                parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", token.string)
                in_names += sum(1 for part in parts if words.match(part))
            elif token.type in (tokenize.STRING, tokenize.COMMENT):
                in_prose += sum(1 for word in re.findall(r"[A-Za-z_]+", token.string) if words.match(word))
    return in_names, in_prose


def copies(files: Iterable[Path]) -> dict[str, int]:
    """In how many files each notion is written."""
    texts = [file.read_text(encoding="utf-8") for file in files]
    return {notion: sum(1 for text in texts if re.search(how, text)) for notion, how in NOTIONS.items()}


def spread(lengths: list[int]) -> str:
    """Median and ninetieth percentile."""
    ninetieth = quantiles(lengths, n=10)[-1] if len(lengths) > 1 else lengths[0]
    return f"{median(lengths):.0f} / {ninetieth:.0f}"


def rows(tree: Path) -> dict[str, str]:
    """Everything that is counted in one checkout, by its name in the table."""
    files = sources(tree)
    rooms: dict[str, list[int]] = defaultdict(list)
    for file in files:
        rooms[room_of(file, tree)].append(code_lines(file))
    lengths = [length for of_room in rooms.values() for length in of_room]
    in_names, in_prose = dialect(files)
    table = {
        "files": f"{len(files)}",
        "lines, not blank": f"{sum(lengths)}",
        "of these with code, not docstring or comment": f"{sum(map(statement_lines, files))}",
        "lines of a file, median / p90": spread(lengths),
        "modules with one importer, in their own folder": f"{len(with_one_importer(tree, files))}",
        "names of modules that collide": f"{colliding(files)}",
        "old words in identifiers": f"{in_names}",
        "old words in prose": f"{in_prose}",
    }
    table |= {f"files with {notion}": f"{count}" for notion, count in copies(files).items()}
    table |= {
        f"{room}/: files, lines, median / p90": f"{len(of_room)}, {sum(of_room)}, {spread(of_room)}"
        for room, of_room in sorted(rooms.items())
    }
    return table


def main(trees: list[Path]) -> None:
    """Print one column for each checkout."""
    counted = [rows(tree.resolve()) for tree in trees]
    print(f"| | {' | '.join(str(tree) for tree in trees)} |")
    print("|---|" + "---|" * len(trees))
    for name in dict.fromkeys(name for column in counted for name in column):
        print(f"| {name} | {' | '.join(column.get(name, '') for column in counted)} |")


if __name__ == "__main__":
    main([Path(tree) for tree in sys.argv[1:]] or [Path(__file__).parents[1]])
