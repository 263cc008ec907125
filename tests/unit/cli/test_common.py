import errno
import json
import logging
import math
import os
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
from fieldkit.model import errors
from fieldkit.phrases import text_document


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


# --- what the user sees and the shell gets when a command fails


@pytest.fixture
def fail(run, monkeypatch, tmp_path):
    """Runs a command that raises what it is given."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))

    def go(error: BaseException, *words: str):
        def command() -> None:
            raise error

        return run(command, *words)

    return go


EXIT_CODES = {
    1: (errors.FieldkitError("x"), RuntimeError("x"), ConnectionResetError(errno.ECONNRESET, "reset")),
    2: (click.UsageError("x"),),
    3: (errors.ConfigError("x"), errors.SessionError("x")),
    4: (errors.DeviceNotFoundError("x"), errors.DeviceAccessError("x"), errors.DeviceTimeoutError("x")),
    5: (errors.DeviceLostError("x"),),
    6: (errors.StorageError("x"),),
    7: (errors.IntegrityError("x"),),
    8: (errors.NoAnswerError("x"), errors.CalibrationError("x")),
    9: (errors.RefusedError("x"),),
    130: (KeyboardInterrupt(), click.Abort()),
}
"""As docs/reference/command-line.md lists them."""


@pytest.mark.parametrize(
    ("code", "error"), [(code, error) for code, raised in EXIT_CODES.items() for error in raised]
)
def test_each_failure_has_its_exit_code(fail, error, code):
    assert fail(error).exit_code == code


def test_an_error_says_what_happened_and_what_to_do_on_one_line_with_json(fail):
    error = errors.DeviceAccessError("refused", place="/dev/x", fix="first\nsecond")
    printed, as_json = fail(error), fail(error, "--json")
    assert (printed.stdout, as_json.stdout, as_json.stderr.count("\n")) == ("", "", 1)
    assert printed.stderr.splitlines() == ["error: /dev/x: refused", "  fix: first", "       second"]
    assert json.loads(as_json.stderr) == {
        "schema": 1, "error": "/dev/x: refused", "fix": "first\nsecond", "exit_code": 4,
        "words": text_document(error.words),
    }  # fmt: skip


@pytest.mark.parametrize(
    "number",
    [errno.EROFS, errno.EACCES, errno.ESTALE, errno.ENAMETOOLONG, errno.EIO, errno.EDQUOT, errno.ENOTDIR],
)
def test_what_a_disk_refuses_is_not_called_a_bug(fail, tmp_path, number):
    result = fail(OSError(number, os.strerror(number), "/media/stick/x.h5"))
    assert result.exit_code == 6
    assert result.stderr.startswith(f"error: /media/stick/x.h5: {os.strerror(number)}\n  fix: ")
    assert not (tmp_path / "fieldkit").exists()


@pytest.mark.parametrize("words", [(), ("--json",)])
def test_an_unexpected_error_leaves_a_log_and_names_it(fail, tmp_path, words):
    result = fail(RuntimeError("the unthinkable"), *words)
    (log,) = (tmp_path / "fieldkit" / "log").glob("*-test.log")
    fix = json.loads(result.stderr)["fix"] if words else result.stderr
    assert str(log) in fix
    assert "RuntimeError: the unthinkable" in result.stderr
    assert "RuntimeError: the unthinkable" in log.read_text()
    assert "Traceback" not in result.stderr


def test_an_unexpected_error_is_shown_where_no_log_can_be_written(fail, tmp_path):
    (tmp_path / "fieldkit").write_text("a file where the folder should be")
    result = fail(RuntimeError("the unthinkable"))
    assert result.exit_code == 1
    assert "Traceback" in result.stderr
