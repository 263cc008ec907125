"""Failures of the command line: explain what happened, and exit with the right code.

A `FieldkitError` is explained (what happened, what to do next). Anything else is a bug:
its traceback goes into a log file whose path is printed.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from fieldkit.cli.common import discard, json_text, options, to_stderr
from fieldkit.cli.next_steps import in_commands
from fieldkit.model.errors import FieldkitError, StorageError
from fieldkit.phrases import text_document

if TYPE_CHECKING:  # every command would wait for it, also --help
    from pathlib import Path

UNEXPECTED = 1
STOPPED = 130
_BROKEN = (errno.EPIPE, errno.ENOSPC)
_OF_A_DISK = (
    *(errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO),
    *(errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.ESTALE),
)
"""Failures by disks, permissions and paths in a command that has no words of its own for it."""


@contextmanager
def explain_failures(ctx: click.Context) -> Iterator[None]:
    """Turn exceptions of a command into messages on stderr and an exit code.

    `FieldkitError` gives its own code, Ctrl-C 130, anything unexpected 1. Errors in what was typed
    (`click.ClickException`, code 2) are left to click. A pipe closed by its reader, such as ``head``, is a
    success: 0; output or files that cannot be written are an error of storage: 6.
    """
    _replace_missing_letters()
    try:
        yield
        sys.stdout.flush()
    except FieldkitError as error:
        explain(error)
        ctx.exit(error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        to_stderr("\nstopped")
        ctx.exit(STOPPED)
    except (click.ClickException, click.exceptions.Exit):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _BROKEN and _stdout_is_broken():
            if not isinstance(error, BrokenPipeError):
                what = f"cannot be written: {error.strerror}"
                explain(StorageError(what, place="the output", fix="send it to another disk"))
            ctx.exit(0 if isinstance(error, BrokenPipeError) else StorageError.exit_code)
        if isinstance(error, OSError) and error.errno in _OF_A_DISK:
            explain(_as_storage_error(error))
            ctx.exit(StorageError.exit_code)
        _report_unexpected(error, ctx.invoked_subcommand or "fieldkit")
        ctx.exit(UNEXPECTED)


def _as_storage_error(error: OSError) -> StorageError:
    fix = "check that the disk has room, and that this user may write there"
    return StorageError(str(error.strerror), place=error.filename, fix=fix)


def _replace_missing_letters() -> None:
    """Replace characters missing from the terminal's encoding, such as ± under LANG=C, instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _stdout_is_broken() -> bool:
    """True if stdout cannot be written any more; its remaining output is then discarded, also at exit.

    Writes a line to find out: after an error Python drops the bytes it could not write.
    """
    try:
        os.write(sys.stdout.fileno(), b"\n")
    except OSError:
        discard(sys.stdout)
        return True
    return False


def explain(error: FieldkitError) -> None:
    """Print what happened and what to do next, each line of the fix under the other.

    With ``--json`` as JSON on one line: message, fix or null, exit code.
    """
    message, fix = in_commands(error.explanation), in_commands(error.fix) if error.fix else None
    if options().json:
        words = text_document(error.words)
        to_stderr(json_text({"error": message, "fix": fix, "exit_code": error.exit_code, "words": words}))
        return
    to_stderr(f"error: {message}")
    if fix:
        to_stderr("  fix: " + fix.replace("\n", "\n       "))


def _report_unexpected(error: Exception, command: str) -> None:
    what = f"failed unexpectedly: {type(error).__name__}: {error}"
    try:
        fix = f"report this bug of fieldkit; details are in {_write_log(error, command)}"
    except OSError:
        import traceback

        traceback.print_exception(error)
        fix = None
    explain(FieldkitError(what, place=command, fix=fix))


def _write_log(error: Exception, command: str) -> Path:
    import platform
    import time
    import traceback

    import platformdirs

    from fieldkit.model.version import __version__

    folder = platformdirs.user_state_path("fieldkit") / "log"
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / f"{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}-{command}.log"
    header = (
        f"fieldkit {__version__}, Python {platform.python_version()}, {platform.platform()}\n{sys.argv}\n"
    )
    log.write_text(header + "".join(traceback.format_exception(error)), encoding="utf-8")
    return log
