"""What made a result: nothing of a notebook's kernel, everything of the command."""

import pytest

from fieldkit.results.result_files import command_line


@pytest.mark.parametrize(
    ("program", "recorded"),
    [
        ("/usr/local/bin/fieldkit", "fieldkit report 'a b.h5'"),
        ("/site-packages/fieldkit/__main__.py", "fieldkit report 'a b.h5'"),  # python -m fieldkit
        ("/site-packages/ipykernel_launcher.py", ""),
        ("my_analysis.py", ""),
    ],
)
def test_only_a_fieldkit_command_is_recorded(monkeypatch, program, recorded):
    monkeypatch.setattr("sys.argv", [program, "report", "a b.h5"])
    assert command_line() == recorded
