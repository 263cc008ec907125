"""A recording split by the time of day: the samples of one session, in sessions complete in themselves."""

import shutil
import subprocess
import sys
from collections import defaultdict
from contextlib import suppress
from datetime import time
from functools import partial

import pytest

import fieldkit
from fieldkit.config.edit import remove_region
from fieldkit.model.durations import times_of_day
from fieldkit.model.errors import ConfigError, RefusedError, StorageError
from fieldkit.model.samples import EventKind, Frame, Severity
from fieldkit.model.units import SECOND_NS
from fieldkit.recording.recordings import is_interrupted, sessions_in
from fieldkit.recording.redrawing import change_regions
from fieldkit.recording.request_reader import recover_session
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.simulation.simulated_clock import SimulatedClock
from tests.harness.page import served
from tests.harness.simulated import simulated_config

FASTEST = ("simulation.speed=max", 'record.sampling="all"')
BOUNDARY_NS = 1_451_674_920_000_000_000  # 2016-01-01T19:02:00Z, a minute after the simulated day's begin
DURATION = "2m10s"  # from 19:00:01, until ten seconds after the boundary


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("1d", ["00:00"]),
        ("24h", ["00:00"]),
        ("8h", ["00:00", "08:00", "16:00"]),
        ("09:30", ["09:30"]),
        ("", []),
    ],
)
def test_times_of_day_at_which_a_recording_is_split(text, times):
    assert times_of_day(text) == tuple(map(time.fromisoformat, times))


@pytest.mark.parametrize("text", ["2d", "7h", "0s", "30s", "25:00", "daily"])
def test_a_time_that_does_not_divide_the_day_is_refused(text):
    with pytest.raises(ConfigError, match=text):
        times_of_day(text)


def samples_of(paths):
    """Stamp, content and flags of every sample by stream."""
    rows = defaultdict(list)
    for path in paths:
        with open_session(path) as session:
            for sample in session.samples():
                content = sample.counts.tobytes() if isinstance(sample, Frame) else sample.values
                rows[sample.stream].append((sample.time_ns, content, sample.quality))
    return rows


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Samples of a recording in one session."""
    folder = tmp_path_factory.mktemp("whole") / "field"
    return samples_of([fieldkit.record(simulated_config(folder, *FASTEST), duration=DURATION).path])


@pytest.fixture(scope="module")
def split(tmp_path_factory):
    """The two sessions of the same recording, in which a region is removed and each minute is marked."""
    folder = tmp_path_factory.mktemp("split") / "field"
    config = simulated_config(folder, *FASTEST, "record.split=2m")

    def act(minute):
        if not (folder / "recordings/removed").exists():
            change_regions(config.path, partial(remove_region, name="b25"))
            (folder / "recordings/removed").touch()
        with suppress(RefusedError):  # the last minute closes when the recording has ended
            fieldkit.mark(f"minute {minute.time_ns // 1000}", config)

    last = fieldkit.record(config, duration=DURATION, on_minute=act)
    paths = sessions_in(folder / "recordings")
    assert last.path == paths[-1]
    return [fieldkit.open_session(path) for path in paths]


def test_no_sample_is_lost_or_twice_and_each_is_in_the_session_of_its_stamp(whole, split):
    assert samples_of(session.path for session in split) == whole
    first, second = (
        [time_ns for samples in samples_of([part.path]).values() for time_ns, *_ in samples] for part in split
    )
    assert max(first) < BOUNDARY_NS <= min(second)
    assert split[1].name == "20160101T190200Z"


def test_both_sessions_are_sealed_and_name_each_other(split):
    first, second = split
    assert [session.state for session in split] == ["sealed", "sealed"]
    (stop,) = [event for event in first.events() if event.kind is EventKind.STOP]
    assert stop.data["next_session"] == second.name
    assert first.name in next(event.text for event in second.events() if event.kind is EventKind.START)


def test_the_second_session_is_complete_without_the_first(split):
    second = split[1]
    assert [region.name for region in second.regions] == ["flat", "b05", "b15"]  # b25 was removed
    with open_session(second.path) as stored:
        assert stored.start_ns == BOUNDARY_NS
        assert stored.clock_checks()
        assert stored.header.config_toml.startswith("schema")
    received = {stream.stream: stream.received for stream in second.health()[-1].streams}
    assert 0 < received["lux"] <= second.count("lux")  # of this session alone
    for session in split:
        estimated = {estimate.region for minute in session.minutes() for estimate in minute.estimates}
        assert {"b05", "b15"} <= estimated
        assert fieldkit.estimate(session)["b15"].n_bins == len(session.minutes())


def test_a_mark_enters_the_session_that_is_being_recorded(split):
    marks = [[event.text for event in part.events() if event.kind is EventKind.MARK] for part in split]
    minutes_us = [minute.time_ns // 1000 for minute in split[0].minutes()]
    assert marks[0] == [f"minute {minutes_us[0]}"]
    assert f"minute {minutes_us[1]}" in marks[1]  # closed when the second one had begun


def test_a_session_that_cannot_be_sealed_is_an_event_of_the_next(tmp_path):
    config = simulated_config(tmp_path, "simulation.speed=max")

    def delete_first_journal(minute):
        if len(sessions_in(config.recordings)) == 1:
            shutil.rmtree(journal_path(*sessions_in(config.recordings)))

    with pytest.raises(StorageError):
        fieldkit.record(config, duration="4m", split="2m", on_minute=delete_first_journal)
    first, second = map(fieldkit.open_session, sessions_in(config.recordings)[:2])
    assert (first.state, second.state) == ("interrupted", "sealed")
    (failure,) = [event for event in second.events() if event.kind is EventKind.DISK]
    assert failure.severity is Severity.ERROR


def test_each_session_has_an_anchor_of_its_own(tmp_path, monkeypatch):
    """The system clock goes wrong by a second and is found so when the next session begins."""
    config = simulated_config(tmp_path, *FASTEST, "record.split=2m")

    def step(clock):
        clock._utc_minus_mono_ns -= SECOND_NS

    monkeypatch.setattr(SimulatedClock, "take_anchor", step)
    fieldkit.record(config, duration=DURATION)
    sessions = [open_session(path) for path in sessions_in(config.recordings)]
    assert sessions[0].anchor_ns - sessions[1].anchor_ns == SECOND_NS
    for session in sessions:
        for entry in [*session.samples(), *session.events(), *session.health()]:
            assert entry.time_ns - entry.mono_ns == session.anchor_ns
        assert not any(session.flags(name).any() for name in ("lux", "thermometer"))
        session.close()


KILLED = """
import os, sys
from pathlib import Path
import fieldkit
from fieldkit.config import load_config
from fieldkit.recording import record

def at_the_second(act):
    calls = []
    def counted(*arguments, **named):
        calls.append(1)
        if len(calls) == int(sys.argv[3]):
            os.kill(os.getpid(), 9)
        return act(*arguments, **named)
    return counted

owner, _, name = sys.argv[2].rpartition(".")
holder = getattr(record, owner) if owner else record
setattr(holder, name, at_the_second(getattr(holder, name)))
file = Path(sys.argv[1]) / "fieldkit.toml"
fieldkit.record(load_config(file, settings=sys.argv[5:]), duration=sys.argv[4], split="2m")
"""


@pytest.mark.parametrize(
    ("function", "call"),
    [
        ("SessionWriter", 2),
        ("Recorder.finish", 1),
        pytest.param("RequestReader.close", 1, marks=pytest.mark.slow),
        pytest.param("Recorder.finish", 2, marks=pytest.mark.slow),
    ],
)
def test_a_recorder_killed_while_one_session_follows_another_loses_nothing(whole, tmp_path, function, call):
    fieldkit.init_campaign(tmp_path / "field", simulated=True)
    words = [str(tmp_path / "field"), function, str(call), DURATION, *FASTEST]
    assert subprocess.run([sys.executable, "-c", KILLED, *words], check=False).returncode == -9
    sessions = sessions_in(tmp_path / "field/recordings")
    for path in sessions:
        if is_interrupted(path):
            recover_session(path)
    rows = samples_of(sessions)
    for stream, samples in whole.items():
        assert rows[stream] == samples[: len(rows[stream])]
        assert len(rows[stream]) >= sum(time_ns < BOUNDARY_NS for time_ns, *_ in samples)


def test_page_status_marks_and_stop_follow_to_the_next_session(tmp_path):
    fieldkit.init_campaign(tmp_path / "field", simulated=True)
    settings = {"preview": True, "simulation__speed": 20, "record__split": "1m"}
    with served(tmp_path / "field", **settings) as page, page.browser() as browser:
        browser.next("state", phase="preview")
        assert browser.request(do="start", name="day", duration="10m")["ok"]
        browser.next("state", phase="recording", session="20160101T190100Z-day")
        assert browser.request(do="mark", text="second")["ok"]
        assert fieldkit.status(tmp_path / "field")["session"].endswith("20160101T190100Z-day.h5")
        assert browser.request(do="stop", confirm=True)["data"]["session"] == "20160101T190100Z-day"
        browser.next("state", phase="preview")
    first, second = map(fieldkit.open_session, sessions_in(tmp_path / "field/recordings"))
    assert (first.state, second.state) == ("sealed", "sealed")
    assert [event.text for event in second.events() if event.kind is EventKind.MARK] == ["second"]
