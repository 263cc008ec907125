"""What made a result: nothing of a notebook's kernel, everything of the command."""

import pytest

from fieldkit.results.result_files import command_line


@pytest.mark.parametrize(
    ("program", "recorded"),
    [
        ("/usr/local/bin/fieldkit", "fieldkit record 'a b' --set 'alarms.command=…'"),
        (
            "/site-packages/fieldkit/__main__.py",
            "fieldkit record 'a b' --set 'alarms.command=…'",
        ),  # python -m fieldkit
        ("/site-packages/ipykernel_launcher.py", ""),
        ("my_analysis.py", ""),
    ],
)
def test_only_a_fieldkit_command_is_recorded(monkeypatch, program, recorded):
    monkeypatch.setattr("sys.argv", [program, "record", "a b", "--set", 'alarms.command=["curl", "s3cr3t"]'])
    assert command_line() == recorded
