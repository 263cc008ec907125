"""What counts as a session of a folder, whatever lies in it, and what a session may be called."""

import json
import os
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldkit.config import load_config
from fieldkit.model.errors import ConfigError
from fieldkit.recording.campaign import open_campaign
from fieldkit.recording.recordings import session_path, sessions_in
from tests.harness.command_line import run_program
from tests.harness.page import campaign
from tests.harness.recording import header, recorded


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A campaign with one sealed session."""
    folder = campaign(tmp_path_factory.mktemp("made") / "field")
    (folder / "recordings").mkdir(exist_ok=True)
    recorded(folder / "recordings" / "a.h5", header((24, 32)), 5)
    return folder


@pytest.fixture
def recordings(made, tmp_path):
    """The folder of a campaign with one sealed session, to be changed."""
    return shutil.copytree(made, tmp_path / "field") / "recordings"


def bind(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        os.chdir(path.parent)  # the name of a socket may have a hundred letters
        bound.bind(path.name)


STRANGE: dict[str, Callable[[Path], object]] = {
    "a link to a file elsewhere": lambda path: path.symlink_to("/etc/passwd"),
    "a link to a session elsewhere": lambda path: path.symlink_to(path.parents[1] / "elsewhere.h5"),
    "a link to a session of the folder": lambda path: path.symlink_to("a.h5"),
    "a link to nothing": lambda path: path.symlink_to("nothing.h5"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to a device": lambda path: path.symlink_to("/dev/zero"),
    "a link to a folder": lambda path: path.symlink_to("."),
    "a folder": lambda path: path.mkdir(),
    "a pipe": os.mkfifo,
    "a socket": bind,
}


@pytest.fixture(params=STRANGE)
def strange(request, recordings, monkeypatch):
    """Something that is called like a session."""
    monkeypatch.chdir(recordings)  # for `bind`, and back afterwards
    (recordings.parent / "elsewhere.h5").write_bytes((recordings / "a.h5").read_bytes())
    path = recordings / "strange.h5"
    STRANGE[request.param](path)
    return path


def test_only_regular_files_of_the_folder_are_its_sessions(strange):
    skipped: list[str] = []
    assert sessions_in(strange.parent, skipped.append) == [strange.parent / "a.h5"]
    assert [text.partition(" is skipped")[0] for text in skipped] == [str(strange)]
    assert open_campaign(strange.parent).sessions.paths == (strange.parent / "a.h5",)


def test_the_journal_of_a_lost_file_is_a_session(recordings):
    (recordings / "b.h5.journal").mkdir()
    assert sessions_in(recordings) == [recordings / "a.h5", recordings / "b.h5"]


@pytest.mark.parametrize(
    "name",
    [
        "two\nlines",
        "\r",
        "a\tb",
        "\x00",
        "\x1b[2J",
        "\x7f",
        "\x85",
        "\u2028",
        "\ud800",
        "latin-1 \udcff",
        "a/b",
        "a\\b",
    ],
)
def test_a_session_is_called_by_text_without_control_characters(recordings, name):
    config = load_config(recordings.parent / "fieldkit.toml")
    with pytest.raises(ConfigError) as caught:
        session_path(config, name, 0)
    assert caught.value.message.isprintable()
    usable = caught.value.fix.value
    assert session_path(config, usable, 0).parent == recordings


@pytest.mark.parametrize("letter", ["x", "ü", "地", "🌡"])
def test_a_session_is_called_by_a_name_that_leaves_room_for_all_that_is_made_of_it(recordings, letter):
    config = load_config(recordings.parent / "fieldkit.toml")
    with pytest.raises(ConfigError, match="120") as caught:
        session_path(config, 240 * letter, 0)
    longest = session_path(config, caught.value.fix.value, 0).stem
    (recordings / f".{longest}-{32 * 's'}-regions.parquet.4194304.new").touch()


def test_other_names_of_sessions_are_free(recordings):
    config = load_config(recordings.parent / "fieldkit.toml")
    for name in ("three beds", "砂 五\u3000度", "=1+1", "..", "-x", "👨\u200d👩"):
        assert session_path(config, name, 0).name == f"19700101T000000Z-{name}.h5"


def test_a_pipe_among_the_sessions_holds_up_no_command(recordings):
    os.mkfifo(recordings / "pipe.h5")
    (recordings / "b.h5.journal").mkdir()
    os.mkfifo(recordings / "b.h5.journal" / "lock")
    done = run_program("ls", "-C", recordings.parent, "--json")
    assert [session["name"] for session in json.loads(done.stdout)["sessions"]] == ["a.h5", "b.h5"]
    assert str(recordings / "pipe.h5") in done.stderr
    assert run_program("status", "-C", recordings.parent).returncode == 9  # nothing is recorded
    named = run_program("show", recordings / "pipe.h5")
    assert (named.returncode, "pipe.h5" in named.stderr) == (3, True)


def test_sessions_are_in_natural_order(tmp_path):
    names = ["d1.h5", "d2.h5", "d10.h5", "day 2 b.h5", "day 10 a.h5", "x20160101T190001Z.h5"]
    for name in names:
        (tmp_path / name).touch()
    assert [path.name for path in sessions_in(tmp_path)] == names
