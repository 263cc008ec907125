"""What a person gets for wrong input, through the real command line: the message and the exit code."""

import re
import shutil
from pathlib import Path

import pytest

from tests.harness import command_line
from tests.harness.rights import ordinary_rights


def fieldkit(*arguments: object) -> tuple[int, str]:
    """Exit code and stderr of one command; nothing may be printed on stdout when it fails."""
    done = command_line.fieldkit(*arguments)
    assert done.exit_code == 0 or done.stdout == ""
    return done.exit_code, done.stderr


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A campaign on simulated devices."""
    folder = tmp_path_factory.mktemp("simulated")
    assert fieldkit("init", folder, "--simulated")[0] == 0
    return folder


@pytest.fixture(scope="module")
def session(simulated):
    """Two recorded minutes."""
    code, said = fieldkit("record", "-C", simulated, "--for", "2m", "--set", "simulation.speed=max")
    assert code == 0, said
    (file,) = (simulated / "recordings").glob("*.h5")
    return file


@pytest.mark.parametrize("planned", [("--for", "1m"), ()], ids=["for a minute", "without an end"])
def test_a_disk_without_room_is_refused_in_units_that_say_how_much_and_exits_6(simulated, planned):
    free_mb = shutil.disk_usage(simulated).free / 1e6
    code, said = fieldkit(
        "record", "-C", simulated, *planned, "--set", f"alarms.disk_reserve_mb={2 * free_mb}"
    )
    assert code == 6
    assert " 0 min" in said
    assert " 0.0 " not in said
    assert re.search(r"\d [kMGT]B ", said)


def record(folder: Path, text: str) -> tuple[int, str]:
    (folder / "fieldkit.toml").write_text(text, encoding="utf-8")
    return fieldkit("record", "-C", folder, "--for", "1s")


def test_a_region_that_leaves_the_cameras_picture_is_refused_when_the_camera_is_there(simulated):
    """The configuration does not say how large the picture is; the camera does."""
    text = re.sub("(?=width_px|height_px)", "#", (simulated / "fieldkit.toml").read_text())
    folder = simulated / "elsewhere"
    folder.mkdir()
    code, message = record(folder, text.replace("[64, 74]", "[640, 74]"))
    assert code == 3
    assert "flat" in message
    assert "160 x 120" in message


@pytest.mark.parametrize("words", [("page",), ("page", "--link", "view")])
def test_a_page_on_a_disk_that_cannot_be_written_exits_6(simulated, tmp_path, words):
    folder = tmp_path / "field"
    shutil.copytree(simulated, folder, ignore=shutil.ignore_patterns("*.h5*"))
    folder.chmod(0o555)
    for inside in folder.iterdir():
        inside.chmod(0o555)
    with ordinary_rights():
        code, message = fieldkit(*words, "-C", folder)
    assert code == 6
    assert str(folder / "recordings") in message
    assert "  fix: " in message
    assert "bug" not in message


@pytest.mark.parametrize(
    ("verb", "kind"),
    [
        *(("estimate", kind) for kind in ("text", "empty", "other HDF5", "absent", "a folder", "truncated")),
        *((verb, "text") for verb in ("replay", "report", "show", "recover")),
    ],
)
def test_a_file_that_is_no_sound_session_exits_3(tmp_path, session, verb, kind):
    file = bad_file(tmp_path / "bad.h5", session, kind)
    code, message = fieldkit(verb, file)
    assert code == 3
    assert message.startswith("error: ")
    assert str(file) in message
    assert "Traceback" not in message


def bad_file(file: Path, session: Path, kind: str) -> Path:
    if kind == "text":
        file.write_text("time,lux\n12:00,52300\n")
    elif kind == "empty":
        file.touch()
    elif kind == "other HDF5":
        import h5py

        with h5py.File(file, "w") as other:
            other["x"] = [1, 2, 3]
    elif kind == "a folder":
        file.mkdir()
    elif kind == "truncated":
        content = session.read_bytes()
        file.write_bytes(content[: len(content) // 2])
    return file
