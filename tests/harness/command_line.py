"""The command line, run in this process."""

from __future__ import annotations

import json
from typing import Any

import click
from click.testing import CliRunner, Result

from fieldkit.cli import main


def fieldkit(*words: object) -> Result:
    """What ``fieldkit WORDS`` prints, and its exit code."""
    return CliRunner().invoke(main, [str(word) for word in words])


def invoke(*words: object) -> None:
    """Run ``fieldkit WORDS``; an error of it is raised as it is, instead of explained on stderr."""
    with main.make_context("fieldkit", [str(word) for word in words]) as context:
        click.Group.invoke(main, context)  # the class of `main` turns errors into messages and exit codes


def succeed(*words: object) -> Result:
    """What ``fieldkit WORDS`` prints, which must end without an error."""
    done = fieldkit(*words)
    assert done.exit_code == 0, done.output
    return done


def document(*words: object) -> Any:
    """The JSON document that ``fieldkit WORDS`` prints."""
    return json.loads(succeed(*words, "--json").stdout)
