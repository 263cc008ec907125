"""Result files: ``BASE.csv``, ``BASE.parquet``, and ``BASE.json`` with their provenance."""

from __future__ import annotations

import json
import math
import platform
import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fieldkit.disk import sha256
from fieldkit.model.errors import ConfigError, FieldkitError, StorageError, message_of, os_errors_as
from fieldkit.results.cache import PACKAGES, code_version
from fieldkit.results.json_document import to_json
from fieldkit.results.sources import Source
from fieldkit.sessions.formats.tables_out import as_text, write_csv

Columns = Mapping[str, Sequence[Any]]
ENDINGS = (".csv", ".parquet", ".json")
_RECALLABLE = "name a session, or the base of the files that an estimate wrote"


def base_path(out: Path, endings: Sequence[str] = ENDINGS) -> Path:
    """The name that the files of a result share, with or without a known ending typed."""
    return out.with_suffix("") if out.suffix in endings else out


def campaign_folder(session: Path, name: str) -> Path | None:
    """The folder of that name of the campaign in whose recordings a session lies; None elsewhere."""
    folder = session.resolve().parent
    return folder.parent / name if folder.name == "recordings" else None


def results_folder(session: Path) -> Path:
    """The ``results`` folder of the campaign a session lies in, or the session's own folder elsewhere."""
    return campaign_folder(session, "results") or session.resolve().parent


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """Make the folder of files to write; an error of the disk becomes a `StorageError`."""
    with os_errors_as(StorageError, "cannot write", place=out, fix="name a folder that can be written"):
        out.parent.mkdir(parents=True, exist_ok=True)
        yield


def write_results(
    base: Path, columns: Columns, about: Mapping[str, Any], beside: Mapping[str, Columns] | None = None
) -> list[Path]:
    """Write ``BASE.csv``, ``BASE.parquet`` with ``fieldkit-slope[lab]``, and their origin in ``BASE.json``.

    `beside` holds further tables, each ``BASE-NAME.csv``. The same runs give the same bytes. Raises
    `StorageError`.
    """
    tables = {"": columns, **{f"-{name}": table for name, table in (beside or {}).items()}}
    document = base.with_name(f"{base.name}.json")
    with writing(base):
        files = [
            path
            for suffix, table in tables.items()
            for path in _write_table(base.with_name(f"{base.name}{suffix}"), table)
        ]
        digests = {path.name: sha256(path) for path in files}
        document.write_text(to_json({**about, "files": digests}) + "\n", encoding="utf-8")
    return [*files, document]


def recall(
    paths: Sequence[Path], settings: tuple[str, ...]
) -> tuple[tuple[Path, ...], tuple[str, ...], bool]:
    """Sessions and settings where results are named instead, and whether the campaign's present ones counted.

    Raises `ConfigError`.
    """
    documents: list[Path] = []
    present = False
    for path in paths:
        document = _document_of(path)
        if document is None:
            documents.append(path)
            continue
        about = _about(document)
        documents.extend(Path(session["path"]) for session in about["sessions"])
        settings = (*about["settings"], *settings)
        present = present or about.get("campaign", False)
    return tuple(documents), settings, present


def earlier_results(base: Path) -> tuple[dict[str, Any], Path]:
    """What an estimate wrote about its slopes, and their table, by the base; raises `ConfigError`."""
    document = _document_of(base)
    if document is None:
        raise ConfigError("no results of an estimate", place=base, fix=_RECALLABLE)
    return _about(document), document.with_suffix(".csv")


def _document_of(path: Path) -> Path | None:
    """The ``BASE.json`` of results, with or without a known ending typed; None where a session is named."""
    if path.exists() and path.suffix not in ENDINGS:
        return None
    base = base_path(path)
    document = base.with_name(f"{base.name}.json")
    return document if document.is_file() else None


def _about(document: Path) -> dict[str, Any]:
    try:
        about = json.loads(document.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot be read: {message_of(error)}", place=document, fix=_RECALLABLE) from error
    keys: set[str] = set(about) if isinstance(about, dict) else set()
    if {"sessions", "parameters"} <= keys:
        raise ConfigError(
            "many sets of parameters", place=document, fix="report its sessions with the settings of one set"
        )
    if not {"sessions", "settings"} <= keys:
        raise ConfigError("not what an estimate wrote", place=document, fix=_RECALLABLE)
    return dict(about)


def _write_table(base: Path, columns: Columns) -> list[Path]:
    table, parquet = (base.with_name(f"{base.name}{ending}") for ending in (".csv", ".parquet"))
    # every digit of an estimate, so that the same runs give the same bytes
    write_csv({name: map(_cell, column) for name, column in columns.items()}, table)
    if find_spec("pyarrow") is None:
        return [table]
    _write_parquet(parquet, columns)
    return [table, parquet]


def _cell(value: Any) -> Any:
    """The value as a cell of CSV; what is not known is empty."""
    if isinstance(value, str):
        return as_text(value)
    return "" if isinstance(value, float) and math.isnan(value) else value


def _write_parquet(path: Path, columns: Columns) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)


# --- provenance: the command typed, the code, its libraries, the sessions by content


def command_line() -> str:
    """The ``fieldkit`` command that is running, as it was typed; empty if another program calls fieldkit.

    The arguments of a notebook's kernel or of a user's script are not ours to record, nor are the words of
    ``alarms.command``, which may hold a secret.
    """
    program = Path(sys.argv[0])
    is_fieldkit = program.stem == "fieldkit" or program.parts[-2:] == ("fieldkit", "__main__.py")
    words = [re.sub("(alarms.*command.*?=).*", r"\1…", word, flags=re.DOTALL) for word in sys.argv[1:]]
    return shlex.join(["fieldkit", *words]) if is_fieldkit else ""


def provenance(sources: Sequence[Source], failures: Mapping[Path, FieldkitError]) -> dict[str, Any]:
    """Provenance of a result: command, code, libraries, sessions by content. No dates, so it repeats."""
    return {
        "command_line": command_line(),
        "code_version": code_version(),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "packages": {name: metadata.version(name) for name in PACKAGES},
        "sessions": [
            {"path": str(source.path), "sha256": source.checksum, "session_id": source.session_id}
            for source in sources
        ],
        "problems": [{"path": str(path), "problem": error.message} for path, error in failures.items()],
    }
