"""What the user sees and the shell gets when a command fails."""

import errno
import json
import os
import sys
from types import ModuleType

import click
import pytest
from click.testing import CliRunner

from fieldkit.cli import CommandTable
from fieldkit.cli.common import Command
from fieldkit.model import errors


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Runs a command that raises what it is given."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))

    def go(error: BaseException, *words: str):
        @click.command(cls=Command)
        def command() -> None:
            raise error

        module = ModuleType("fieldkit.cli.fail")
        module.command = command
        monkeypatch.setitem(sys.modules, module.__name__, module)
        table = CommandTable({"Test": {"fail": "Fails."}}, name="fieldkit")
        return CliRunner().invoke(table, ["fail", *words])

    return go


# exit codes as docs/reference/command-line.md lists them
@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.FieldkitError("x"), 1),
        (errors.ConfigError("x"), 3),
        (errors.SessionError("x"), 3),
        (errors.DeviceNotFoundError("x"), 4),
        (errors.DeviceAccessError("x"), 4),
        (errors.DeviceTimeoutError("x"), 4),
        (errors.DeviceLostError("x"), 5),
        (errors.StorageError("x"), 6),
        (errors.IntegrityError("x"), 7),
        (errors.NoAnswerError("x"), 8),
        (errors.CalibrationError("x"), 8),
        (errors.RefusedError("x"), 9),
        (click.UsageError("x"), 2),
        (KeyboardInterrupt(), 130),
        (click.Abort(), 130),
        (RuntimeError("x"), 1),
    ],
)
def test_each_failure_has_its_exit_code(run, error, code):
    assert run(error).exit_code == code


def test_an_error_says_what_happened_and_what_to_do(run):
    result = run(errors.DeviceAccessError("refused", place="/dev/x", fix="first\nsecond"))
    assert result.stdout == ""
    assert result.stderr.splitlines() == ["error: /dev/x: refused", "  fix: first", "       second"]


def test_with_json_an_error_is_one_line_of_it(run):
    result = run(errors.DeviceAccessError("refused", place="/dev/x", fix="first\nsecond"), "--json")
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert json.loads(result.stderr) == {
        "schema": 1, "error": "/dev/x: refused", "fix": "first\nsecond", "exit_code": 4,
    }  # fmt: skip


def test_with_json_an_unexpected_error_names_its_log(run, tmp_path):
    document = json.loads(run(RuntimeError("unthinkable"), "--json").stderr)
    (log,) = (tmp_path / "fieldkit" / "log").glob("*-fail.log")
    assert document["error"].startswith("fail: ")
    assert document["error"].endswith("RuntimeError: unthinkable")
    assert document["fix"].endswith(str(log))
    assert document["exit_code"] == 1


@pytest.mark.parametrize(
    "number",
    [errno.EROFS, errno.EACCES, errno.ESTALE, errno.ENAMETOOLONG, errno.EIO, errno.EDQUOT, errno.ENOTDIR],
)
def test_what_a_disk_refuses_is_not_called_a_bug(run, tmp_path, number):
    result = run(OSError(number, os.strerror(number), "/media/stick/x.h5"))
    assert result.exit_code == 6
    assert result.stderr.startswith(f"error: /media/stick/x.h5: {os.strerror(number)}\n  fix: ")
    assert not (tmp_path / "fieldkit").exists()


def test_other_errors_of_the_system_are_unexpected(run):
    assert run(ConnectionResetError(errno.ECONNRESET, "reset")).exit_code == 1


def test_an_unexpected_error_leaves_a_log_and_names_it(run, tmp_path):
    result = run(RuntimeError("the unthinkable"))
    (log,) = (tmp_path / "fieldkit" / "log").glob("*-fail.log")
    assert str(log) in result.stderr
    assert "RuntimeError: the unthinkable" in log.read_text()
    assert "Traceback" not in result.stderr


def test_an_unexpected_error_is_shown_where_no_log_can_be_written(run, tmp_path):
    (tmp_path / "fieldkit").write_text("a file where the folder should be")
    result = run(RuntimeError("the unthinkable"))
    assert result.exit_code == 1
    assert "Traceback" in result.stderr
