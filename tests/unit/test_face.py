"""``import fieldkit``: what a notebook is offered, and what it shows of an object."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import fieldkit
from fieldkit.model.errors import FieldkitError, SessionError
from fieldkit.sessions.writer import SessionWriter
from tests.harness.recording import CountedClock, fill, header


@pytest.fixture
def session(tmp_path: Path):
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "field.h5", header((24, 32)), clock)
    fill(writer, 10, clock)
    writer.close()
    with fieldkit.open_session(tmp_path / "field.h5") as opened:
        yield opened


def typed_names() -> set[str]:
    """The names that type checkers see: the imports under ``TYPE_CHECKING``."""
    tree = ast.parse(Path(fieldkit.__file__).read_text("utf-8"))
    checked = next(node for node in tree.body if isinstance(node, ast.If))
    return {alias.asname or alias.name for node in checked.body for alias in node.names}


def test_completion_offers_what_is_public_and_nothing_else():
    assert set(dir(fieldkit)) == {"__version__", *typed_names()} == set(fieldkit.__all__)


@pytest.mark.parametrize("name", sorted(typed_names()))
def test_every_public_name_is_there_and_documented(name):
    assert getattr(fieldkit, name).__doc__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = fieldkit.nothing


def test_completion_imports_nothing():
    code = "import sys, fieldkit; dir(fieldkit); print([m for m in sys.modules if m.startswith('fieldkit.')])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_errors_carry_what_to_do_next():
    assert issubclass(SessionError, fieldkit.FieldkitError)
    assert fieldkit.FieldkitError is FieldkitError
    with pytest.raises(fieldkit.FieldkitError) as caught:
        fieldkit.open_session("nowhere.h5")
    assert caught.value.fix
    assert caught.value.fix in str(caught.value)


def test_a_session_shows_its_name_state_and_streams(session):
    assert repr(session).startswith("<Session field: sealed, ")
    assert all(name in repr(session) and name in session._repr_html_() for name in session.streams)


def test_a_stream_that_is_not_there_names_those_that_are(session):
    with pytest.raises(SessionError, match="camera"):
        session["nope"]


def test_a_session_without_regions_plots_its_first_meter(session):
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    axes = session.plot(Figure().subplots())
    assert axes.lines
    assert "local time" in axes.get_xlabel()
