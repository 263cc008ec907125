"""Commands beside a recording load none of the heavy libraries, and report what its recorder knows."""

import json
import math
import os
import shlex
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

import fieldkit
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.status import status_reply, stored_status
from fieldkit.recording.status_request import feed_path, recorder_status
from fieldkit.views import unix_socket
from tests.harness.command_line import document, succeed
from tests.harness.recorder_process import recorder
from tests.harness.seldom import SET_SELDOM
from tests.harness.waiting import wait_until

HEAVY = {
    *("numpy", "scipy", "h5py", "astropy", "erfa", "cv2", "pandas", "matplotlib"),
    *("pydantic", "tomlkit", "serial", "usb", "starlette", "uvicorn"),
}
RUN = """
import contextlib, io, json, sys
from fieldkit.cli import main
results = []
for words in json.loads(sys.argv[1]):
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        try:
            main(words)
        except SystemExit as end:
            results.append((end.code, output.getvalue()))
print(json.dumps((results, sorted({name.partition(".")[0] for name in sys.modules}))))
"""


def run(*commands: str) -> list[tuple[int, str]]:
    """Exit code and output of commands in one process, which loads no heavy library for them."""
    words = json.dumps([shlex.split(command) for command in commands])
    done = subprocess.run([sys.executable, "-c", RUN, words], capture_output=True, text=True, check=True)
    results, modules = json.loads(done.stdout)
    assert not HEAVY & set(modules)
    return [(code, output) for code, output in results]


@contextmanager
def recorded_in(folder):
    """A simulated recording whose minutes last two seconds, once its recorder replies."""
    init_campaign(folder, simulated=True)
    with recorder(folder, "--set", "simulation.speed=30", *SET_SELDOM) as (session, process):
        wait_until(lambda: recorder_status(session), "the recorder does not reply", every_s=0.1)
        yield folder, session, process


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    with recorded_in(tmp_path_factory.mktemp("light") / "field") as running:
        yield running


def test_help_loads_no_heavy_library():
    results = run("--help", "status --help", "ls --help", "--version", "--cite")
    assert [code for code, _ in results] == [0] * 5
    assert all(printed.startswith("Usage:") for _, printed in results[:3])
    assert results[3][1].startswith(f"fieldkit {fieldkit.__version__} (")


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


def assert_nothing_runs(folder):
    """Every command about a running recording refuses, and says how to begin one."""
    verbs = ("mark x", "stop", "status", "shutter")
    for code, printed in run(*(f"{verb} -C {folder}" for verb in verbs)):
        assert code == 9, printed
        assert printed.splitlines()[1].split() == ["fix:", "fieldkit", "record"]


def test_without_a_recording_the_refusal_loads_no_heavy_library(tmp_path):
    (tmp_path / "fieldkit.toml").touch()
    assert_nothing_runs(tmp_path)


def test_marks_of_every_form_and_the_shutter_load_no_heavy_library(recording):
    words = ("wind", "noon --at 12:00", "shade-test b15", "cloud -k cloud --from=-9s --until=-1s")
    *marks, unknown, shutter = run(
        *(f"mark -C {recording[0]} {text}" for text in words),
        f"mark -C {recording[0]} shade-test b16",
        f"shutter -C {recording[0]}",
    )
    assert all(code == 0 and "marked in" in printed for code, printed in marks), marks
    assert unknown[0] == 3
    assert "b16: " in unknown[1]
    assert shutter[0] == 0


def test_the_status_has_the_latest_slopes_without_heavy_libraries(recording):
    folder, session, _ = recording
    wait_until(lambda: recorder_status(session)["document"]["slopes"], "no minute is over", every_s=0.1)
    results = run(f"status -C {folder} --json", f"status -C {folder}", f"ls -C {folder}")
    assert [code for code, _ in results] == [0] * 3
    document, status, listed = (printed for _, printed in results)
    known = json.loads(document)
    slopes = known["slopes"]
    assert known["streams"]["lux"].keys() == {"rate_hz", "age_s", "lost", "garbled", "implausible", "gaps"}
    assert known["streams"]["lux"]["lost"] == 0
    assert known["streams"]["lux"]["rate_hz"] > 0
    assert known["disk"]["disk_free_bytes"] > known["disk"]["written_bytes"] > 0
    assert known["clock"]["changed"] is None
    assert 0 < known["clock"]["since_ns"] < slopes[0]["time_ns"]
    assert known["irradiance"]["dni_w_m2"] > 0
    assert 0 < known["sun"]["sun_zenith_deg"] < 90
    assert known["alarms"] == []
    assert {"b05", "b15", "b25"} <= {slope["region"] for slope in slopes}
    assert f"recording {session.name} since" in status
    assert "\x1b" not in status  # no colours in a pipe
    assert session.name in listed


def test_the_recorder_reports_what_its_session_holds(recording):
    """Of a stopped recorder the same is worked out from the file."""
    _, session, process = recording
    reported, stored = {}, {"slopes": []}
    # until no minute closes in between, and the last is whole: part of one has no temperatures in the file
    while not stored["slopes"] or times(reported) != times(stored) or not has_temperatures(stored):
        if (answer := recorder_status(session)) is None:  # a busy computer; it was stopped a moment ago
            continue
        reported = answer["document"]
        os.kill(process.pid, signal.SIGSTOP)
        try:
            # the kernel stops it when it runs next; then there is no answer, at once
            wait_until(lambda: recorder_status(session) is None, "it runs on", every_s=0.01)
            stored = json.loads(json.dumps(status_reply(stored_status(session), 80)["document"]))
        finally:
            os.kill(process.pid, signal.SIGCONT)
    assert reported.keys() == stored.keys()
    assert reported["counts"].keys() == stored["counts"].keys()
    for ours, theirs in zip(reported["slopes"], stored["slopes"], strict=True):
        assert (ours["region"], ours["state"]) == (theirs["region"], theirs["state"])
        assert known(ours["tilt_deg"]) == pytest.approx(known(theirs["tilt_deg"]), rel=1e-6)
    assert reported["surface_temperature_k"] == pytest.approx(stored["surface_temperature_k"], abs=1e-6)


def has_temperatures(document) -> bool:
    return all(map(math.isfinite, document["surface_temperature_k"].values()))


def times(document) -> list[int]:
    """Microseconds, as sessions keep them."""
    return [slope["time_ns"] // 1000 for slope in document["slopes"]]


def known(value: float | None) -> float:
    """A number of a document, -1 for none: null in the recorder's JSON, NaN in Python."""
    return -1.0 if value is None or value != value else value


def test_a_request_that_is_not_one_gets_no_answer_and_the_next_one_does(recording):
    session = recording[1]
    bad_headers = ("", "{}", "[]", "[3, 4]", '["Status", {"cols": "x"}]')
    for bad in (b"", b"\xff" * 30, *map(unix_socket.message, bad_headers)):
        with unix_socket.connect(feed_path(session), 10.0) as connection:
            connection.sendall(bad)
            connection.shutdown(1)
            assert connection.recv(1) == b""
    assert recorder_status(session)["regions"] == ["flat", "b05", "b15", "b25"]
    assert feed_path(session).stat().st_mode & 0o777 == 0o600


def test_a_killed_recorder_leaves_nothing_that_looks_like_a_recording(tmp_path):
    with recorded_in(tmp_path / "field") as (folder, session, process):
        process.kill()
        process.wait()
        assert feed_path(session).is_socket()  # it is still there, and nothing listens
        assert_nothing_runs(folder)
        assert "interrupted" in succeed("ls", "-C", folder).stdout


def test_sealed_sessions_are_listed_without_opening_them_again(tmp_path, recording):
    folder, session, process = recording
    ((code, printed),) = run(f"stop -C {folder}")
    assert code == 0, printed
    assert process.wait() == 0
    first = document("ls", "-C", folder)
    ((_, again),) = run(f"ls -C {folder} --json")
    assert json.loads(again) == first
    assert first["sessions"][0]["state"] == "sealed"
    session.write_bytes(session.read_bytes()[:1000])  # another file of that name is opened
    assert document("ls", "-C", folder)["sessions"][0]["state"] == "unreadable"
