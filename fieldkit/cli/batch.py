"""Shared by the commands over many sessions: progress, names of results, failures at the end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import common
from fieldkit.model.errors import FieldkitError, IntegrityError, SessionError

if TYPE_CHECKING:
    from fieldkit.results.batch import Progress


@contextmanager
def progress_bar(task_name: str) -> Iterator[Progress]:
    """A bar on stderr; the yielded function moves it."""
    with common.progress() as bar:
        task = bar.add_task(task_name, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def base_of(out: Path, endings: Sequence[str] = ()) -> Path:
    """The name that the files of a result share; a path without a name is a usage error."""
    from fieldkit.results.result_files import ENDINGS, base_path

    if out.name in ("", ".."):
        raise click.UsageError(f"-o {out} names no file; write {out / 'NAME'}")
    return base_path(out, endings or ENDINGS)


def raise_failures(failures: Mapping[Path, FieldkitError], paths: Iterable[Path]) -> None:
    """Explain what failed and raise what gives the exit code; for a single session its own error."""
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
