"""Commands beside a recording load none of the heavy libraries, and report what its recorder knows."""

import json
import os
import signal
import subprocess
import sys

import pytest

import fieldkit
from fieldkit.recording.running import session_in_progress
from fieldkit.recording.status import status_reply, stored_status
from fieldkit.recording.status_request import recorder_status, status_path
from fieldkit.views import unix_socket
from tests.harness.seldom import SET_SELDOM
from tests.harness.waiting import wait_until

HEAVY = {
    *("numpy", "scipy", "h5py", "astropy", "erfa", "cv2", "pandas", "matplotlib"),
    *("pydantic", "tomlkit", "serial", "usb", "starlette", "uvicorn"),
}
RUN = """
import sys
from fieldkit.cli import main
try:
    main(sys.argv[1:])
except SystemExit as end:
    code = end.code
print("loaded:", code, *sorted({name.partition(".")[0] for name in sys.modules}))
"""


def run(*words: str) -> tuple[int, str, set[str]]:
    """Exit code and output of a command in a process of its own, and the heavy libraries that it loaded."""
    done = subprocess.run([sys.executable, "-c", RUN, *words], capture_output=True, text=True, check=True)
    printed, _, loaded = done.stdout.rpartition("loaded: ")
    code, *modules = loaded.split()
    return int(code), printed + done.stderr, HEAVY & set(modules)


def begun(folder):
    """The process of a simulated recording, whose minutes last two seconds, once its recorder answers."""
    command = [sys.executable, "-m", "fieldkit"]
    subprocess.run([*command, "init", "--simulated", str(folder)], check=True, capture_output=True)
    process = subprocess.Popen(
        [*command, "record", "-C", str(folder), "--quiet", "--set", "simulation.speed=30", *SET_SELDOM]
    )
    recordings = folder / "recordings"

    def answers() -> bool:
        assert process.poll() is None
        session = session_in_progress(recordings)
        return session is not None and bool(recorder_status(session))

    wait_until(answers, "the recorder does not answer", every_s=0.1)
    return process, session_in_progress(recordings)


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("light") / "field"
    process, session = begun(folder)
    yield folder, session, process
    process.kill()
    process.wait()


VERSION = f"fieldkit {fieldkit.__version__} ("


@pytest.mark.parametrize(
    ("words", "begin"),
    [
        ("--help", "Usage:"),
        ("status --help", "Usage:"),
        ("ls --help", "Usage:"),
        ("--version", VERSION),
        ("--cite", ""),
    ],
)
def test_help_loads_no_heavy_library(words, begin):
    code, printed, heavy = run(*words.split())
    assert (code, heavy) == (0, set())
    assert printed.startswith(begin)


@pytest.mark.parametrize(
    ("module", "unused"),
    [
        ("fieldkit", HEAVY),
        ("fieldkit.drivers.discovery", {"cv2", "erfa", "astropy_iers_data"}),
        *(
            (f"fieldkit.{name}", {"cv2", "astropy"})
            for name in ("recording.plan", "results.check", "physics.sun")
        ),
    ],
)
def test_opencv_and_astropy_are_imported_where_they_are_used(module, unused):
    code = f"import sys, {module}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not unused & {name.partition(".")[0] for name in loaded.split()}


@pytest.mark.parametrize("words", [("mark", "x"), ("stop",), ("status",), ("shutter",)])
def test_without_a_recording_the_refusal_loads_no_heavy_library(tmp_path, words):
    (tmp_path / "fieldkit.toml").touch()
    command, *rest = words
    code, printed, heavy = run(command, "-C", str(tmp_path), *rest)
    assert (code, heavy) == (9, set())
    assert printed.splitlines()[1].split() == ["fix:", "fieldkit", "record"]


@pytest.mark.parametrize(
    "words",
    [
        ("wind",),
        ("noon", "--at", "12:00"),
        ("shade-test", "b15"),
        ("cloud", "-k", "cloud", "--from=-9s", "--until=-1s"),
    ],
)
def test_marks_of_every_form_load_no_heavy_library(recording, words):
    code, printed, heavy = run("mark", "-C", str(recording[0]), *words)
    assert (code, heavy) == (0, set()), printed
    assert "marked in" in printed


def test_a_shade_test_of_a_region_that_the_recorder_has_not_is_refused(recording):
    code, printed, heavy = run("mark", "-C", str(recording[0]), "shade-test b16")
    assert (code, heavy) == (2, set())
    assert "b16: " in printed


def test_the_shutter_is_asked_for_without_heavy_libraries(recording):
    code, printed, heavy = run("shutter", "-C", str(recording[0]))
    assert (code, heavy) == (0, set()), printed


def test_the_status_has_the_latest_slopes_without_heavy_libraries(recording):
    folder, session, _ = recording
    wait_until(lambda: recorder_status(session)["document"]["slopes"], "no minute is over", every_s=0.1)
    code, printed, heavy = run("status", "-C", str(folder), "--json")
    assert (code, heavy) == (0, set()), printed
    slopes = json.loads(printed)["slopes"]
    assert {"b05", "b15", "b25"} <= {slope["region"] for slope in slopes}
    code, printed, heavy = run("status", "-C", str(folder))
    assert (code, heavy) == (0, set()), printed
    assert f"recording {session.name} since" in printed
    assert "\x1b" not in printed  # no colours in a pipe


def test_a_running_recording_is_listed_without_heavy_libraries(recording):
    code, printed, heavy = run("ls", "-C", str(recording[0]))
    assert (code, heavy) == (0, set()), printed
    assert recording[1].name in printed


def test_the_recorder_reports_what_its_session_holds(recording):
    """Of a stopped recorder the same is worked out from the file."""
    _, session, process = recording
    reported, stored = {}, {"slopes": []}
    while not stored["slopes"] or times(reported) != times(stored):  # a minute has closed in between
        if (answer := recorder_status(session)) is None:  # a busy computer; it was stopped a moment ago
            continue
        reported = answer["document"]
        os.kill(process.pid, signal.SIGSTOP)
        try:
            assert recorder_status(session) is None  # at once, not after a time limit
            stored = json.loads(json.dumps(status_reply(stored_status(session), 80)["document"]))
        finally:
            os.kill(process.pid, signal.SIGCONT)
    assert reported.keys() == stored.keys()
    assert reported["counts"].keys() == stored["counts"].keys()
    for ours, theirs in zip(reported["slopes"], stored["slopes"], strict=True):
        assert (ours["region"], ours["state"]) == (theirs["region"], theirs["state"])
        assert known(ours["tilt_deg"]) == pytest.approx(known(theirs["tilt_deg"]), rel=1e-6)
    assert reported["surface_temperature_k"] == pytest.approx(stored["surface_temperature_k"], abs=1e-6)


def times(document) -> list[int]:
    """Microseconds, as sessions keep them."""
    return [slope["time_ns"] // 1000 for slope in document["slopes"]]


def known(value: float | None) -> float:
    """A number of a document, -1 for none: null in the recorder's JSON, NaN in Python."""
    return -1.0 if value is None or value != value else value


def test_a_request_that_is_not_one_gets_no_answer_and_the_next_one_does(recording):
    session = recording[1]
    for bad in (b"", b"{}", b"[]", b'{"cols": "x"}', b"\xff"):
        with unix_socket.connect(status_path(session), 10.0) as connection:
            connection.sendall(bad)
            connection.shutdown(1)
            assert connection.recv(1) == b""
    assert recorder_status(session)["regions"] == ["flat", "b05", "b15", "b25"]
    assert status_path(session).stat().st_mode & 0o777 == 0o600


def test_a_killed_recorder_leaves_nothing_that_looks_like_a_recording(tmp_path):
    folder = tmp_path / "field"
    process, session = begun(folder)
    process.kill()
    process.wait()
    assert status_path(session).is_socket()  # it is still there, and nothing listens
    for words in (("status",), ("mark", "x"), ("stop",)):
        command, *rest = words
        code, printed, heavy = run(command, "-C", str(folder), *rest)
        assert (code, heavy) == (9, set()), printed
        assert printed.splitlines()[1].split() == ["fix:", "fieldkit", "record"]
    code, printed, _ = run("ls", "-C", str(folder))
    assert "interrupted" in printed


def test_sealed_sessions_are_listed_without_opening_them_again(tmp_path, recording):
    folder, session, process = recording
    code, printed, heavy = run("stop", "-C", str(folder))
    assert (code, heavy) == (0, set()), printed
    assert process.wait() == 0
    first, again = (run("ls", "-C", str(folder), "--json") for _ in range(2))
    assert first[0] == again[0] == 0
    assert json.loads(first[1]) == json.loads(again[1])
    assert again[2] == set()
    assert json.loads(again[1])["sessions"][0]["state"] == "sealed"
    session.write_bytes(session.read_bytes()[:1000])  # another file of that name is opened
    assert json.loads(run("ls", "-C", str(folder), "--json")[1])["sessions"][0]["state"] == "unreadable"
