"""What the command line does when something fails: explain it, and exit with the right code.

A `FieldkitError` is explained (what happened, what to do next). Anything else is a bug:
its traceback goes into a log file whose path is printed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from fieldkit.errors import FieldkitError

UNEXPECTED = 1
STOPPED = 130


@contextmanager
def explained(ctx: click.Context) -> Iterator[None]:
    """Turn exceptions of a verb into messages on stderr and an exit code.

    `FieldkitError` gives its own code, Ctrl-C 130, anything unexpected 1. Errors in what was
    typed (`click.ClickException`, code 2) and a reader that closed the pipe are left to click.
    """
    try:
        yield
    except FieldkitError as error:
        explain(error)
        ctx.exit(error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        click.echo("\nstopped", err=True)
        ctx.exit(STOPPED)
    except (click.ClickException, click.exceptions.Exit, BrokenPipeError):
        raise
    except Exception as error:
        _tell_unexpected(error, ctx.invoked_subcommand or "fieldkit")
        ctx.exit(UNEXPECTED)


def explain(error: FieldkitError) -> None:
    """Print what happened and what to do next, each line of the fix under the other."""
    click.echo(f"error: {error.message}", err=True)
    if error.fix:
        click.echo("  fix: " + error.fix.replace("\n", "\n       "), err=True)


def _tell_unexpected(error: Exception, verb: str) -> None:
    click.echo(f"error: {verb} failed unexpectedly: {type(error).__name__}: {error}", err=True)
    try:
        log = _write_log(error, verb)
    except OSError:
        import traceback

        traceback.print_exception(error)
    else:
        click.echo(f"  this is a mistake in fieldkit; the details are in {log}", err=True)


def _write_log(error: Exception, verb: str) -> Path:
    import platform
    import sys
    import time
    import traceback

    import platformdirs

    from fieldkit import __version__

    folder = platformdirs.user_state_path("fieldkit") / "log"
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / f"{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}-{verb}.log"
    header = (
        f"fieldkit {__version__}, Python {platform.python_version()}, {platform.platform()}\n{sys.argv}\n"
    )
    log.write_text(header + "".join(traceback.format_exception(error)), encoding="utf-8")
    return log
