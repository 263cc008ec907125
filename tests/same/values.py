"""The values that a checkout finds in a session, as text by name."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from tests.same.program import Program

_VOLATILE = re.compile(
    r"(?m)^.*(fieldkit[ _-]?(version|commit)|made by|[0-9a-f]{64}|"
    r"\"?(version|commit|platform|command|sha256|session_id|seconds|took)).*$"
)
"""Lines that differ from run to run, or name the code that made them."""
HEALTH = re.compile(r"-health\.|-clock\.")
"""Tables of the computer's own state, which is another in each recording."""


def values_of(program: Program, source: Path, folder: Path) -> Iterator[tuple[str, str]]:
    """Name and text of everything that `program` finds in a copy of `source` in `folder`."""
    if source.suffix == ".csv":
        site = ("--site", "37.70,-105.92,2317")
        yield "estimate", program.run("estimate", source.name, *site, "--json", cwd=folder)
        return
    yield "check", program.run("check", source.name, "--json", cwd=folder)
    yield "show", program.run("show", source.name, "--json", cwd=folder)
    yield "estimate", program.run("estimate", source.name, "--json", cwd=folder)
    for output, words in {
        "slopes": ("estimate", source.name, "-o", "slopes"),
        "map": ("map", source.name, "-o", "map", "--products", "slope,heading"),
        "report": ("report", source.name, "-o", "report.html"),
        "csv": ("export", source.name, "--to", "csv", "-o", "csv"),
        "netcdf": ("export", source.name, "--to", "netcdf", "-o", "netcdf"),
    }.items():
        before = set(_files(folder))
        yield f"{output} printed", program.run(*words, cwd=folder)
        for path in sorted(path for path in set(_files(folder)) - before if not HEALTH.search(path.name)):
            yield f"{output} {path.relative_to(folder)}", content_of(path)


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file() and ".cache" not in path.parts)


def content_of(path: Path) -> str:
    """A file as lines of text: the words of a page, the values of arrays, tables as they are."""
    if path.suffix == ".html":
        return html.unescape(re.sub(r"(?s)<(script|style).*?</\1>|<[^>]+>", "\n", path.read_text()))
    if path.suffix == ".nc":
        return "\n".join(_arrays(path))
    if path.suffix in {".csv", ".json", ".txt", ".svg"}:
        return path.read_text()
    return "a file"  # pictures are made of the arrays compared above


def _arrays(path: Path) -> Iterator[str]:
    """Each value of each array of an HDF5 file, to its last bit."""
    found: list[tuple[str, np.ndarray]] = []
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: found.append((name, item[()])) if isinstance(item, h5py.Dataset) else None
        )
    for name, values in found:
        for place, value in enumerate(np.asarray(values).ravel().tolist()):
            yield f"{name}[{place}] {value!r}"


def comparable(text: str, folder: Path) -> list[str]:
    """The lines of a text without what differs from run to run."""
    text = text.replace(str(folder), "<folder>")
    return [line.strip() for line in _VOLATILE.sub("", text).splitlines() if line.strip()]
