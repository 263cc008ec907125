"""``fieldkit export``: a session for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from fieldkit.cli.common import Command, options, print_json
from fieldkit.cli.session_paths import latest_session
from fieldkit.model.errors import ConfigError, IncompleteError, IntegrityError, StorageError

if TYPE_CHECKING:
    from fieldkit.sessions.reader import Session

WHOLE_KINDS = ("csv", "parquet", "netcdf")
"""What is always written of every stream."""
PICTURE_KINDS = ("png", "mp4", "tiff")
KINDS = (*WHOLE_KINDS, "mcap", *PICTURE_KINDS)


@click.command(cls=Command)
@click.argument("session", required=False, type=click.Path(path_type=Path))
@click.option("--to", "kind", type=click.Choice(KINDS), required=True, help="What to write.")
@click.option("-o", "--out", type=click.Path(path_type=Path), metavar="DIR", help="[default: results/NAME]")
@click.option(
    "--stream", metavar="NAME", help="Which camera, if there are several; of MCAP, only this stream."
)
@click.option("--every", type=click.IntRange(1), default=1, help="Only every n-th picture.")
@click.pass_context
def command(
    ctx: click.Context, session: Path | None, kind: str, out: Path | None, stream: str | None, every: int
) -> None:
    """Write SESSION (default: the newest) for other programs.

    Tables as CSV or Parquet, one row a sample, units in the header; netCDF, one file a stream;
    MCAP, everything in one file for its viewers; pictures as PNG, film, or 16-bit TIFF of 0.01 K per count.
    """
    from fieldkit.sessions.reader import open_session

    if stream is not None and kind in WHOLE_KINDS:
        raise ConfigError(
            f"--stream {stream}: --to {kind} writes every stream, each into a file of its own",
            fix="leave out --stream",
        )
    path = latest_session(ctx, session)
    folder = out or _default_folder(path)
    with open_session(path) as opened:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            written, problems = _write(opened, folder, kind, stream, every)
        except OSError as error:
            raise StorageError(f"cannot write into {folder}: {error.strerror or error}") from error
        problems += _damage(opened, kind)
    _print(ctx, path, folder, written, problems)
    if problems:
        raise IntegrityError(f"{path}: {'; '.join(problems)}", fix=f"fieldkit check {path}")


def _damage(session: Session, kind: str) -> list[str]:
    """What the export found of samples that are not as they were recorded."""
    fate = "they are omitted" if kind in PICTURE_KINDS else "they are flagged bad_crc"
    return [
        f"{count} of {session.count(name)} samples of {name} do not match their checksum, {fate}"
        for name, count in session.damaged.items()
    ]


def _print(ctx: click.Context, path: Path, folder: Path, written: list[Path], problems: list[str]) -> None:
    if options(ctx).json:
        files = [str(file) for file in written]
        print_json({"session": str(path), "files": files, "problems": problems})
        return
    for file in written[:10]:
        click.echo(file)
    if len(written) > 10:
        click.echo(f"and {len(written) - 10} more in {folder}")


def _default_folder(path: Path) -> Path:
    """``results/NAME`` of the campaign the session lies in, or a folder beside the session."""
    parent = path.resolve().parent
    return (
        parent.parent / "results" / path.stem
        if parent.name == "recordings"
        else parent / f"{path.stem}-export"
    )


def _write(
    session: Session, folder: Path, kind: str, stream: str | None, every: int
) -> tuple[list[Path], list[str]]:
    """The files, and what could not be read for them."""
    from fieldkit.sessions.formats import images_out, mcap_out, tables_out

    samples = {
        "mcap": mcap_out.export_mcap,
        "png": images_out.export_pngs, "mp4": images_out.export_mp4, "tiff": images_out.export_tiffs,
    }  # fmt: skip
    try:
        if kind in ("csv", "parquet"):
            return tables_out.export_tables(session, folder, kind), []
        if kind == "netcdf":
            return tables_out.export_netcdf(session, folder), []
        return samples[kind](session, folder, stream=stream, every=every), []
    except IncompleteError as error:
        return list(error.files), [error.message]
