"""The command line, run in this process or in one of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import click
from click.testing import CliRunner, Result

from fieldkit.cli import main

PROGRAM = (sys.executable, "-m", "fieldkit")


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


def program(*words: object, **options: Any) -> subprocess.Popen[str]:
    """The process of ``fieldkit WORDS``, what it prints in pipes."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([*PROGRAM, *map(str, words)], text=True, **{**pipes, **options})


def run_program(*words: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """The same once it has ended."""
    command = [*PROGRAM, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def run_code(code: str, *words: object, **options: Any) -> str:
    """What Python code prints in a process of its own, which must end without an error."""
    command = [sys.executable, "-c", code, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout
