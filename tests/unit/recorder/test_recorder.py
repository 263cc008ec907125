"""A recording through the real program, on simulated devices, whose estimator, views or user give up."""

import json
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from click.testing import Result

from fieldkit.estimation.estimator import Estimator
from fieldkit.estimation.following import RegionFollower
from fieldkit.model.alarm import phase_of
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.recording.request_reader import RequestReader
from fieldkit.recording.running import stop_recording
from fieldkit.sessions.lock import is_locked, journal_path
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import fieldkit, succeed
from tests.harness.learnt import learnt
from tests.harness.waiting import wait_until

LENGTH_S = 100
BURSTS_OF_3 = 2
"""Of the camera, each minute; the meters are read each second."""


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "sand"
    succeed("init", "--simulated", folder)
    return folder


def record(campaign: Path, *words: str) -> Result:
    fast = ("--set", "simulation.speed=max")
    return fieldkit("record", "-C", campaign, "--for", f"{LENGTH_S}s", "--name", "x", *fast, *words)


def the_session(campaign: Path) -> Path:
    (path,) = (campaign / "recordings").glob("*.h5")
    return path


def after(count: int, act: Callable[[], None], genuine: Callable[..., object]) -> Callable[..., object]:
    """A method that acts at its call number `count` and at all later ones."""
    calls = 0

    def called(*given: object) -> object:
        nonlocal calls
        calls += 1
        if calls >= count:
            act()
        return genuine(*given)

    return called


def stored(path: Path) -> tuple[dict[str, int], list[Event]]:
    with open_session(path) as session:
        assert session.state == "sealed"
        return {name: session.count(name) for name in session.streams}, session.events()


def is_whole(counts: dict[str, int]) -> bool:
    """Whether every instrument was recorded to the end."""
    meters = [count for name, count in counts.items() if name != "camera"]
    return counts["camera"] == 3 * BURSTS_OF_3 and all(abs(count - LENGTH_S) <= 1 for count in meters)


@pytest.mark.parametrize(
    ("part", "method", "at"),
    [
        *((Estimator, "collect", 100), (Estimator, "minute", 1), (RegionFollower, "update", 2)),
        (Estimator, "collect_rest", 1),  # at the very end
    ],
)
def test_an_estimator_that_fails_is_left_out_once_and_the_recording_goes_on(
    campaign, monkeypatch, part, method, at
):
    failures = []

    def fail() -> None:
        failures.append(1)
        raise ZeroDivisionError("dark")

    # only a mistake of ours raises this
    monkeypatch.setattr(part, method, after(at, fail, getattr(part, method)))
    done = record(campaign)
    assert done.exit_code == 0, done.output
    counts, events = stored(the_session(campaign))
    assert is_whole(counts)
    (lost,) = [event for event in events if event.kind is EventKind.ESTIMATOR]
    assert (lost.severity, "ZeroDivisionError('dark')" in lost.text) == (Severity.ERROR, True)
    assert failures == [1]  # it is not asked again


def test_what_the_data_taught_is_stored_with_the_slopes(campaign, monkeypatch):
    found = learnt()
    genuine = Estimator.minute
    # the learned model takes a day of minutes to learn all of this
    monkeypatch.setattr(
        Estimator, "minute", lambda self, closed: replace(genuine(self, closed), learnt=found)
    )
    done = record(campaign, "--json")
    assert done.exit_code == 0, done.output
    with open_session(the_session(campaign)) as session:
        minutes = session.minutes()
        assert (
            session.end_ns - session.clock_checks()[-1].mono_ns - session.anchor_ns < 10**9
        )  # at the end too
        assert session.learnt() == {minute.time_ns: minute.learnt for minute in minutes}
    assert minutes
    assert all(minute.learnt.parameters == found.parameters for minute in minutes)
    told = json.loads(done.stdout)["learnt"]
    assert told["parameters"][0] == {**asdict(found.parameters[0])}
    assert told["chi_square"] == found.chi_square
    shown = fieldkit("show", the_session(campaign)).output
    assert "depth, cm" in shown
    assert "3.6 (2.3 to 5.7)" in shown


def test_a_second_ctrl_c_leaves_a_journal_that_gives_everything_back(campaign, monkeypatch):
    """The first asks to seal; the second ends at once, wherever the program is."""

    def interrupt() -> None:
        raise KeyboardInterrupt

    # a second Ctrl-C that comes while the estimator works, which a signal cannot be timed to
    monkeypatch.setattr(Estimator, "collect", after(100, interrupt, Estimator.collect))
    done = record(campaign)
    assert done.exit_code != 0
    path = the_session(campaign)
    assert "fieldkit recover" in done.output
    assert not is_locked(journal_path(path))
    succeed("recover", path, "--json")
    with open_session(path) as session:
        assert session.state == "recovered"
        assert sum(session.count(name) for name in session.streams) == 100
        assert all(len(list(session.samples(name))) == session.count(name) for name in session.streams)


HANGING = """
import sys, threading
from fieldkit.cli import main
from fieldkit.config import FILE_NAME, load_config
from fieldkit.estimation.estimator import Estimator
from fieldkit.recorder import recorder

def hang(self, closed):
    print("hangs", flush=True)
    threading.Event().wait()

Estimator.minute = hang
recorder.LONGEST_WAIT_S = float(sys.argv[1])
main(["record", *sys.argv[2:]])
"""


@pytest.fixture
def hanging(campaign):
    """Begins a recording whose estimator hangs in its first minute, waits for that; kills what is left."""
    begun: list[subprocess.Popen[str]] = []

    def begin(longest_wait_s: float, *words: str) -> subprocess.Popen[str]:
        fast = ["-C", str(campaign), "--set", "simulation.speed=60", *words]
        command = [sys.executable, "-c", HANGING, str(longest_wait_s), *fast]
        begun.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
        assert begun[-1].stdout is not None
        assert begun[-1].stdout.readline() == "hangs\n"
        return begun[-1]

    yield begin
    for process in begun:
        process.kill()
        process.communicate()


def gives_up(path: Path) -> None:
    """The session is sealed, says that estimates stopped, and raised that alarm and no other."""
    _, events = stored(path)
    (lost,) = [event for event in events if event.kind is EventKind.ESTIMATOR]
    assert lost.severity is Severity.ERROR
    assert re.search(r"\b[123] s\b", lost.text)  # how long was waited for the estimates
    assert [event.data["alarm"] for event in events if phase_of(event)] == ["estimator"]


def test_a_recording_whose_estimator_hangs_ends_as_planned(campaign, hanging):
    done = hanging(1.0, "--for", "100s", "--quiet")
    _, errors = done.communicate(timeout=120)
    assert done.returncode == 0, errors
    gives_up(the_session(campaign))
    assert is_whole(stored(the_session(campaign))[0])


@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, *(pytest.param(one, marks=pytest.mark.slow) for one in (signal.SIGTERM, signal.SIGHUP))],
)
def test_a_recording_whose_estimator_hangs_is_sealed_at_a_signal(campaign, hanging, number):
    done = hanging(2.0, "--quiet")
    done.send_signal(number)
    _, errors = done.communicate(timeout=120)
    assert done.returncode == 0, errors
    gives_up(the_session(campaign))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (signal.SIGINT, signal.SIGTERM),
        pytest.param(signal.SIGTERM, signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, signal.SIGTERM, marks=pytest.mark.slow),
    ],
)
def test_a_second_signal_ends_a_recording_whose_estimator_hangs_and_keeps_its_journal(
    campaign, hanging, first, second
):
    done = hanging(3600.0)
    marks = journal_path(the_session(campaign)) / "marks"
    done.send_signal(first)
    wait_until(lambda: done.poll() is not None or not marks.exists(), "it does not end")
    assert done.poll() is None  # closed once the recorder is ending
    done.send_signal(second)
    _, errors = done.communicate(timeout=120)
    assert done.returncode != 0
    assert "fieldkit recover" in errors
    succeed("recover", the_session(campaign))
    with open_session(the_session(campaign)) as session:
        assert session.state == "recovered"
        assert session.count("thermometer") >= 60


def test_a_stop_that_is_repeated_still_seals(campaign, hanging):
    done = hanging(3.0)
    with ThreadPoolExecutor() as pool:
        stopped = [pool.submit(stop_recording, campaign / "recordings", print) for _ in range(3)]
        assert {one.result() for one in stopped} == {the_session(campaign)}
    assert done.wait(120) == 0
    gives_up(the_session(campaign))


def test_estimates_that_are_late_are_an_event_and_so_is_their_return(campaign, monkeypatch):
    """Of a first minute that takes half a second where a fifth of one is late; the others come as they do."""
    # a slow computer, without its minutes of waiting; simulated time does not wait for it
    monkeypatch.setattr("fieldkit.recorder.health.LATE_S", 0.2)
    monkeypatch.setattr("fieldkit.recorder.sample_queue.SampleQueue.is_settled", lambda self, timeout_s: True)
    genuine, held = Estimator.minute, threading.Event()

    def slow(self: Estimator, closed: object) -> object:
        if not held.is_set():
            held.wait(0.5)
            held.set()
        return genuine(self, closed)

    monkeypatch.setattr(Estimator, "minute", slow)
    assert record(campaign, "--for", "300s", "--set", "simulation.speed=60").exit_code == 0
    _, events = stored(the_session(campaign))
    late = [(event.data["late"], event.severity) for event in events if "late" in event.data]
    assert late[:2] == [
        ("begin", Severity.WARNING),
        ("end", Severity.INFO),
    ]  # a busy computer may be late again


def test_what_is_noted_last_and_what_the_estimator_notices_is_in_the_session(campaign, monkeypatch):
    last = Event(EventKind.MARK, 1, 1, "packing up")
    genuine = RequestReader.close
    # sent between the last look at the inbox and its end, a moment that nothing outside can hit
    monkeypatch.setattr(RequestReader, "close", lambda self: [last, *genuine(self)])
    done = record(campaign, "--set", "simulation.faults=['cloud']", "--json")
    assert done.exit_code == 0, done.output
    counts, events = stored(the_session(campaign))
    assert "packing up" in [event.text for event in events if event.kind is EventKind.MARK]
    assert [event for event in events if event.kind is EventKind.CLOUD]
    told = json.loads(done.stdout)
    assert told["counts"] == counts
