"""``import fieldkit``: what a notebook is offered, and what it shows of an object."""

from __future__ import annotations

import ast
import pkgutil
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import fieldkit
from fieldkit.model.errors import FieldkitError, SessionError
from tests.harness.command_line import run_code
from tests.harness.recording import header, recorded


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "field.h5"
    recorded(path, header((24, 32)), 10)
    return path


@pytest.fixture
def session(made, tmp_path):
    with fieldkit.open_session(shutil.copy(made, tmp_path)) as opened:
        yield opened


def typed_names() -> set[str]:
    """The names that type checkers see: the imports under ``TYPE_CHECKING``."""
    tree = ast.parse(Path(fieldkit.__file__).read_text("utf-8"))
    checked = next(node for node in tree.body if isinstance(node, ast.If))
    return {alias.asname or alias.name for node in checked.body for alias in node.names}


def test_completion_offers_what_is_public_and_nothing_else():
    assert set(dir(fieldkit)) == {"__version__", *typed_names()} == set(fieldkit.__all__)


REFERENCE = Path(__file__).parents[2] / "docs" / "reference" / "api.md"


def described() -> list[str]:
    """What the reference of the documentation describes, as dotted names."""
    return re.findall(r"^::: (\S+)$", REFERENCE.read_text("utf-8"), re.MULTILINE)


def test_the_reference_describes_every_public_name_and_nothing_private():
    names = {name.rpartition(".")[2] for name in described()}
    assert names >= typed_names() - {"calibrate"} | set(fieldkit.calibrate.__all__)
    assert not [name for name in described() if "._" in name]


@pytest.mark.parametrize("name", described())
def test_what_the_reference_describes_is_documented_to_its_last_member(name):
    described = pkgutil.resolve_name(name)
    assert described.__doc__
    members = vars(described).items() if isinstance(described, type) else ()
    bare = [
        key
        for key, one in members
        if key[0] != "_" and callable(getattr(one, "fget", one)) and not one.__doc__
    ]
    assert bare == []


def test_a_misspelt_name_is_suggested():
    with pytest.raises(AttributeError, match="'estimate'"):
        _ = fieldkit.estimat


def test_completion_imports_nothing_but_the_version():
    code = "import sys, fieldkit; dir(fieldkit); print(*sorted(m for m in sys.modules if 'fieldkit.' in m))"
    assert run_code(code).split() == ["fieldkit.model", "fieldkit.model.version"]


def test_errors_carry_what_to_do_next():
    assert issubclass(SessionError, fieldkit.FieldkitError)
    assert fieldkit.FieldkitError is FieldkitError
    with pytest.raises(fieldkit.FieldkitError) as caught:
        fieldkit.open_session("nowhere.h5")
    assert caught.value.fix
    assert str(caught.value.fix) in str(caught.value)


def test_a_session_shows_its_name_state_and_streams(session):
    assert repr(session).startswith("<Session field: sealed, ")
    assert all(name in repr(session) and name in session._repr_html_() for name in session.streams)


@pytest.mark.parametrize(("name", "suggestion"), [("nope", "camera, lux"), ("camra", "did you mean camera")])
def test_a_stream_that_is_not_there_names_those_that_are(session, name, suggestion):
    with pytest.raises(SessionError, match=f"(?s)'{name}'.*{suggestion}"):
        session[name]


def test_samples_of_a_stream_by_their_place(session):
    stream = session["camera"]
    frames = list(stream)
    assert len(frames) == len(stream) > 2
    for place in (0, 1, -1):
        np.testing.assert_array_equal(stream[place].counts, stream.counts[place])
        assert stream[place].time_ns == stream.times_ns()[place]
    for part in (slice(1, 3), slice(-2, None), slice(None, None, -1), slice(5, 2)):
        assert [frame.seq for frame in stream[part]] == [frame.seq for frame in frames[part]]
    with pytest.raises(IndexError):
        stream[len(stream)]


def test_a_session_without_regions_and_its_streams_plot_themselves(session):
    from matplotlib.figure import Figure

    axes = session.plot(Figure().subplots())
    assert axes.lines
    assert "local time" in axes.get_xlabel()
    for name, info in session.streams.items():
        axes = session[name].plot(Figure().subplots())
        assert info.is_camera or info.unit in axes.get_ylabel()


def test_an_import_shows_its_streams_and_warnings_and_opens(tmp_path):
    (tmp_path / "log.csv").write_text(
        "time,light [lx]\n2026-05-12 12:00:00,50000\n2026-05-12 12:01:00,51000\n", "utf-8"
    )
    options = fieldkit.ImportOptions(site=fieldkit.Site(47.1, 8.5, 400.0, "Europe/Zurich"), zone="UTC")
    made = fieldkit.import_recording(tmp_path / "log.csv", tmp_path / "log.h5", options, campaign=tmp_path)
    assert repr(made).startswith(f"<ImportedSession {made.path}: 2 logger")
    with made.open() as session:
        assert isinstance(session, fieldkit.Session)
        assert session["logger"].readings().values.ravel().tolist() == [50000.0, 51000.0]


@pytest.mark.parametrize(
    ("call", "fix"),
    [
        (lambda session: fieldkit.report([]), "give a session"),
        (lambda session: fieldkit.record(duration=-3.0), "3h"),
        (lambda session: fieldkit.Campaign.sweep(session, {"albedo": 0.2}, sessions=[]), r"\[0.15, 0.2"),
    ],
    ids=["report", "record", "sweep"],
)
def test_a_wrong_argument_is_explained(session, call, fix, tmp_path, monkeypatch):
    fieldkit.init_campaign(tmp_path / "field", simulated=True)
    monkeypatch.chdir(tmp_path / "field")
    with pytest.raises(fieldkit.FieldkitError, match=fix):
        call(session)


def test_a_calibration_takes_a_session_or_its_file(session):
    for given in (session, session.path):
        with pytest.raises(fieldkit.FieldkitError, match="region none"):
            fieldkit.calibrate.surface(given, beds=["none"])
    assert session.count("camera") > 0  # still open
