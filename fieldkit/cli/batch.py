"""What `estimate` and `sweep` share: looking at sessions, carrying out runs, results and recalling them."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click
import numpy as np

import fieldkit.workflows.batch
from fieldkit.cli import common
from fieldkit.model.errors import ConfigError, FieldkitError, IntegrityError, SessionError, StorageError
from fieldkit.model.samples import Quality
from fieldkit.model.site import RegionKind
from fieldkit.sessions.formats.tables_out import as_text
from fieldkit.workflows import executors
from fieldkit.workflows.batch import Failure, Outcome, Run
from fieldkit.workflows.cache import Cache
from fieldkit.workflows.json_document import to_json
from fieldkit.workflows.sources import Source, source_of

Columns = Mapping[str, Sequence[Any]]
ENDINGS = (".csv", ".parquet", ".json")
_RECALLABLE = "name a session, or the BASE of fieldkit estimate -o BASE"
Failures = dict[Path, FieldkitError]


@contextmanager
def workers(kind: str, address: str | None, jobs: int | None, runs: int) -> Iterator[Executor]:
    """Who carries out the runs, as the options say; no more processes than runs."""
    if (kind == "dask") != (address is not None):
        raise click.UsageError("--executor dask and --address belong together")
    if address is not None:
        with executors.dask(address) as executor:
            yield executor
        return
    with executors.local(max(1, min(jobs or executors.cores(), runs))) as executor:
        yield executor


def look_at(paths: Sequence[Path], *, present: bool) -> tuple[list[Source], Failures]:
    """Every session that can be read, and why the others cannot; a session named twice counts once."""
    sources: list[Source] = []
    failures: Failures = {}
    for path in dict.fromkeys(path.resolve() for path in paths):
        try:
            source = source_of(path, present=present)
            _refuse_without_beds(source)
            sources.append(source)
        except FieldkitError as error:
            failures[path] = error
    return sources, failures


def _refuse_without_beds(source: Source) -> None:
    if not any(region.kind is RegionKind.TARGET for region in source.regions):
        raise ConfigError(
            f"{source.path} has no beds to estimate: no region is a target",
            fix="fieldkit roi add in its campaign, then once more with --campaign",
        )


def carried_out(runs: Sequence[Run], executor: Executor, failures: Failures) -> Iterator[Outcome]:
    """The outcomes of runs as they come, known ones first; a bar tells the time to go.

    Sessions that cannot be read, or only in part, are added to `failures`.
    """
    with common.progress() as bar:
        task = bar.add_task("estimating", total=len(runs))
        for outcome in fieldkit.workflows.batch.carried_out(runs, executor, Cache()):
            bar.advance(task)
            if isinstance(outcome, Failure):
                failures[outcome.run.source.path] = outcome.error
                continue
            if (damage := _damage(outcome)) is not None:
                failures[outcome.run.source.path] = damage
            yield outcome


def complain(failures: Failures, paths: Iterable[Path]) -> None:
    """Explain what is wrong with sessions and raise what gives the exit code; of a single one its own."""
    from fieldkit.cli.failure import explain

    total = len({path.resolve() for path in paths})
    if failures and total == 1:
        raise next(iter(failures.values()))
    for error in failures.values():
        explain(error)
    damaged = sum(isinstance(error, IntegrityError) for error in failures.values())
    if missing := len(failures) - damaged:
        raise SessionError(f"{missing} of {total} sessions could not be estimated; the others are done")
    if damaged:
        raise IntegrityError(f"{damaged} of {total} sessions are damaged in part; what is sound was used")


def _damage(outcome: Outcome) -> IntegrityError | None:
    """What to say of a session in which samples do not match their checksums; the estimator left them out."""
    rows = outcome.estimates.rows
    minutes = np.unique(rows["time_ns"][(rows["flags"] & int(Quality.BAD_CRC)) != 0]).size
    if not minutes:
        return None
    path = outcome.run.source.path
    return IntegrityError(
        f"{path} has damaged samples in {minutes} minutes; they were left out", fix=f"fieldkit check {path}"
    )


def write_results(base: Path, columns: Columns, about: Mapping[str, Any]) -> list[Path]:
    """Write ``BASE.csv``, ``BASE.parquet`` with ``fieldkit[lab]``, and ``BASE.json``: where it all came from.

    The same runs give the same bytes. Raises `StorageError`.
    """
    table, parquet, document = (base.with_name(f"{base.name}{ending}") for ending in ENDINGS)
    try:
        base.parent.mkdir(parents=True, exist_ok=True)
        _write_csv(table, columns)
        written = [table]
        if find_spec("pyarrow") is not None:
            _write_parquet(parquet, columns)
            written.append(parquet)
        digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in written}
        document.write_text(to_json({**about, "files": digests}) + "\n", encoding="utf-8")
    except OSError as error:
        raise StorageError(
            f"cannot write {base}: {error.strerror}", fix="name another place with -o"
        ) from error
    return [*written, document]


def base_of(out: Path, endings: Sequence[str] = ENDINGS) -> Path:
    """Results come in several files: the name they share, with or without a known ending typed."""
    if out.name in ("", ".."):
        raise click.UsageError(f"-o {out} names no file; write {out / 'NAME'}")
    return out.with_suffix("") if out.suffix in endings else out


def recalled(
    paths: Sequence[Path], settings: tuple[str, ...]
) -> tuple[tuple[Path, ...], tuple[str, ...], bool]:
    """Sessions and settings where results are named instead, and whether the campaign's present ones counted.

    Raises `ConfigError`.
    """
    found: list[Path] = []
    present = False
    for path in paths:
        document = _document_of(path)
        if document is None:
            found.append(path)
            continue
        about = _about(document)
        found.extend(Path(session["path"]) for session in about["sessions"])
        settings = (*about["settings"], *settings)
        present = present or about.get("campaign", False)
    return tuple(found), settings, present


def _document_of(path: Path) -> Path | None:
    """The ``BASE.json`` of results, with or without a known ending typed; None where a session is named."""
    if path.exists() and path.suffix not in ENDINGS:
        return None
    base = base_of(path)
    document = base.with_name(f"{base.name}.json")
    return document if document.is_file() else None


def _about(document: Path) -> dict[str, Any]:
    try:
        about = json.loads(document.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"{document} cannot be read: {error}", fix=_RECALLABLE) from error
    known: set[str] = set(about) if isinstance(about, dict) else set()
    if {"sessions", "parameters"} <= known:
        raise ConfigError(
            f"{document} has many sets of parameters", fix="report its sessions with --set of one set"
        )
    if not {"sessions", "settings"} <= known:
        raise ConfigError(f"{document} is not what estimate -o wrote", fix=_RECALLABLE)
    return dict(about)


def _write_csv(path: Path, columns: Columns) -> None:
    """A header and a row for each place of the columns; what is not known is empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(as_text, columns))
        writer.writerows([_cell(value) for value in row] for row in zip(*columns.values(), strict=True))


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return as_text(value)
    return "" if isinstance(value, float) and math.isnan(value) else value


def _write_parquet(path: Path, columns: Columns) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)
