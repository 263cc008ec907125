import json
import logging
import math
import sys
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

import click
import numpy as np
import pytest
from click.testing import CliRunner

from fieldkit.cli import CommandTable, common
from fieldkit.cli.common import Command


@pytest.fixture
def run(monkeypatch):
    """Runs a function as a command with the given arguments."""

    def go(function, *arguments: str):
        module = ModuleType("fieldkit.cli.test")
        module.command = click.command(cls=Command)(function)
        monkeypatch.setitem(sys.modules, module.__name__, module)
        table = CommandTable({"Test": {"test": "Test."}}, name="fieldkit")
        return CliRunner().invoke(table, ["test", *arguments])

    yield go
    logging.basicConfig(force=True, level=logging.WARNING)


def test_the_common_options_reach_the_command(run, tmp_path):
    seen = []
    arguments = ["-C", str(tmp_path), "--json", "-q", "-vv", "--no-color", "--no-input"]
    run(click.pass_obj(seen.append), *arguments)
    assert seen == [common.Options(tmp_path, True, True, 2, True, True)]


def test_a_folder_that_does_not_exist_is_wrong_usage(run):
    assert run(lambda: None, "-C", "/no/such/folder").exit_code == 2


def test_json_has_a_schema_and_no_nan(run):
    document = {
        "nan": math.nan,
        "array": np.array([1.5, math.inf]),
        "number": np.int64(3),
        "time": datetime(2026, 12, 11, tzinfo=UTC),
        "path": Path("a/b"),
        "words": ("ä", {"x": None}),
    }
    printed = run(lambda: common.print_json(document)).stdout
    assert json.loads(printed, parse_constant=pytest.fail) == {
        "schema": 1,
        "nan": None,
        "array": [1.5, None],
        "number": 3,
        "time": "2026-12-11T00:00:00+00:00",
        "path": "a/b",
        "words": ["ä", {"x": None}],
    }


def test_json_lines_are_one_object_each(run):
    printed = run(lambda: [common.print_json({"n": n}, on_one_line=True) for n in range(3)]).stdout
    assert [json.loads(line) for line in printed.splitlines()] == [{"schema": 1, "n": n} for n in range(3)]


def test_messages_go_to_stderr_and_quiet_silences_them(run):
    assert run(lambda: common.say("hello")).stderr == "hello\n"
    assert run(lambda: common.say("hello")).stdout == ""
    assert run(lambda: common.say("hello"), "--quiet").stderr == ""


def test_a_table_in_a_pipe_keeps_long_cells_whole_and_uncoloured(run):
    long = "recordings/20261211T025512Z-a-session-with-quite-a-long-name-three-beds-and-a-reference.h5"
    printed = run(lambda: common.print_table(("name", "n"), [(long, 1), ("[bold]", 2)])).stdout
    assert long in printed
    assert "[bold]" in printed
    assert "\x1b" not in printed


def test_progress_is_silent_in_a_pipe(run):
    def work() -> None:
        with common.progress() as bar:
            bar.advance(bar.add_task("working", total=1))

    result = run(work)
    assert (result.exit_code, result.output) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "level"),
    [(("-q",), logging.ERROR), ((), logging.WARNING), (("-v",), logging.INFO), (("-vvv",), logging.DEBUG)],
)
def test_verbosity_sets_what_is_logged(run, arguments, level):
    levels = []
    run(lambda: levels.append(logging.getLogger().level), *arguments)
    assert levels == [level]
