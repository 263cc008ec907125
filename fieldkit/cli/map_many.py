"""The maps of many sessions: each the work of one worker, written here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli import batch, common
from fieldkit.cli.map import base_of, damage, document, print_map, remarks, write
from fieldkit.model.errors import FieldkitError
from fieldkit.workflows.executors import Work

if TYPE_CHECKING:
    from fieldkit.workflows.slope_map import MappedSession

Made = dict[Path, tuple["MappedSession", list[Path]]]


def map_many(
    paths: Sequence[Path],
    out: Path | None,
    map_session: Callable[[Path], MappedSession],
    settings: tuple[str, ...],
    workers: tuple[str, str | None, int | None],
) -> None:
    """Map sessions and write the maps into the folder `out`, or each where its own is written.

    `map_session` travels to the workers; they need no disk but that of the recordings. What cannot be
    mapped is told at the end and gives the exit code, the others are done.
    """
    bases = _bases(paths, out)
    made: Made = {}
    failures: batch.Failures = {}
    with batch.workers(*workers, len(paths)) as executor, common.progress() as bar:
        task = bar.add_task("mapping", total=len(bases))
        work: Work[Path] = Work(executor)
        for path in bases:
            work.hand_out(path, partial(map_session, path.resolve()))
        for path, found in work.results():
            bar.advance(task)
            if isinstance(found, FieldkitError):
                failures[path] = found
            else:
                made[path] = found, write(bases[path], path, found, settings)
                if (error := damage(path, found)) is not None:
                    failures[path] = error
    _tell({path: made[path] for path in bases if path in made})
    batch.complain(failures, bases)


def _bases(paths: Sequence[Path], out: Path | None) -> dict[Path, Path]:
    """What the files of each session are called; a session named twice counts once."""
    bases = {path: base_of(out and out / f"{path.stem}-slope-map", path) for path in dict.fromkeys(paths)}
    if len(set(bases.values())) < len(bases):
        raise click.UsageError("two sessions of one name would be written into one file: map them one by one")
    return bases


def _tell(made: Made) -> None:
    for remark in dict.fromkeys(remark for found, _ in made.values() for remark in remarks(found)):
        common.say(remark)
    if common.options().json:
        common.print_json({"sessions": [document(path, *one) for path, one in made.items()]})
        return
    for path, (found, files) in made.items():
        click.echo(path.stem)
        print_map(found, files)
