"""``fieldkit export``: a session for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, is_interactive, print_if_json, progress
from fieldkit.cli.session_paths import latest_session
from fieldkit.cli.types import PATH, SPEED
from fieldkit.model.errors import IntegrityError
from fieldkit.model.next_step import Action
from fieldkit.palettes import NAMES
from fieldkit.sessions.formats.exports import EXPORTS

if TYPE_CHECKING:
    from fieldkit.results.export import Export

MOST_NAMES = 10
FORMATS = "\n".join(f"{name:<10} {export_format.meaning}" for name, export_format in EXPORTS.items())


# options go into `export` under its own names
@click.command(cls=Command, help=f"Write SESSION (default: the latest) for other programs.\n\n\b\n{FORMATS}")
@click.argument("session", required=False, type=PATH)
@click.option("--to", type=click.Choice(tuple(EXPORTS)), required=True, help="Format to write.")
@click.option("-o", "--out", "folder", type=PATH, metavar="DIR", help="[default: results/NAME]")
@click.option("--stream", metavar="NAME", help="Camera, if there are several; of mcap, any stream.")
@click.option("--every", type=click.IntRange(1), default=1, help="Only every n-th frame.")
@click.option(
    "--from", "begin", metavar="TIME", help="Only frames since 12:31, 2026-12-11T12:31 or -5m (from the end)."
)
@click.option("--until", metavar="TIME", help="Only frames up to then.")
@click.option("--speed", type=SPEED, help="Session seconds per second of video. [default: max, 25 frames]")
@click.option("--palette", type=click.Choice(NAMES), help="Colours of images and videos. [default: inferno]")
@click.option(
    "--license", metavar="SPDX", help="Licence of an RO-Crate, such as CC-BY-4.0; written to fieldkit.toml."
)
def command(session: Path | None, to: str, **options: Any) -> None:
    """Write a session for other programs."""
    from fieldkit.results.export import campaign_facts, export
    from fieldkit.sessions.reader import open_session

    path = latest_session(session)
    with open_session(path) as opened, progress() as bar:
        if "license" in EXPORTS[to].takes and is_interactive() and not options["license"]:
            known = campaign_facts(opened)["license"]
            options["license"] = known or click.prompt("Licence of the data", "CC-BY-4.0", err=True)
        frames = sum(opened.count(stream.name) for stream in opened.streams.values() if stream.is_camera)
        task = bar.add_task(f"writing {to}", total=frames)
        exported = export(opened, to, on_frame=lambda: bar.advance(task), **options)
    _print(path, exported)
    if exported.problems:
        raise IntegrityError(f"{'; '.join(exported.problems)}", place=path, fix=Action.CHECK(path))


def _print(session: Path, exported: Export) -> None:
    files = [str(file) for file in exported.files]
    if print_if_json({"session": str(session), "files": files, "problems": list(exported.problems)}):
        return
    for file in exported.files[:MOST_NAMES]:
        click.echo(file)
    if len(exported.files) > MOST_NAMES:
        click.echo(f"and {len(exported.files) - MOST_NAMES} more in {exported.folder}")
