"""The command line, run in this process."""

from __future__ import annotations

from click.testing import CliRunner, Result

from fieldkit.cli import main


def fieldkit(*words: object) -> Result:
    """What ``fieldkit WORDS`` prints, and its exit code."""
    return CliRunner().invoke(main, [str(word) for word in words])
