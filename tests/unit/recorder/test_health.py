from dataclasses import replace
from pathlib import Path

import pytest

from fieldkit.model.clock import ClockCheck
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import EventKind, Quality, Reading, Severity
from fieldkit.recorder.health import (
    ClockMonitor,
    DiskMonitor,
    FlagMonitor,
    GarbleMonitor,
    HealthMonitor,
    StorageMonitor,
)
from fieldkit.recorder.sample_queue import SampleQueue
from fieldkit.sessions.finished_file import propose_time_map
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation.simulated_clock import SimulatedClock
from tests.harness.recording import START_NS, header, sample

S = 1_000_000_000
MB = 1_000_000


def reading(quality: Quality) -> Reading:
    return Reading("lux", 0, 0, (1.0,), quality=quality)


def test_a_flag_is_reported_when_it_begins_not_while_it_lasts():
    monitor = FlagMonitor()
    flags = [Quality.GOOD, Quality.OVERRANGE, Quality.OVERRANGE, Quality.GOOD, Quality.OVERRANGE]
    reported = [[event.kind for event in monitor.update(reading(flag))] for flag in flags]
    assert reported == [[], [EventKind.OVERRANGE], [], [], [EventKind.OVERRANGE]]


def test_a_second_flag_is_reported_and_the_first_not_again():
    monitor = FlagMonitor()
    flags = [Quality.NO_VALUE, Quality.NO_VALUE | Quality.OVERRANGE, Quality.NO_VALUE]
    assert [len(list(monitor.update(reading(flag)))) for flag in flags] == [1, 1, 0]


def test_garbled_records_are_reported_with_their_number_once_a_minute_and_at_the_end():
    monitor = GarbleMonitor()
    counts = [(0, 0, False), (3, 1, False), (5, 2, False), (9, 62, False), (11, 63, True), (11, 64, True)]
    reported = [
        [event.data["records"] for event in monitor.update("lux", records, s * S, s * S, at_end=at_end)]
        for records, s, at_end in counts
    ]
    assert reported == [[], [3], [], [6], [2], []]


def test_a_shrinking_disk_warns_then_stops_pictures_then_asks_to_seal():
    monitor = DiskMonitor(reserve_bytes=64 * MB)
    assert not list(monitor.update(10_000 * MB, 1 * MB, 0, 0))
    assert [e.kind for e in monitor.update(500 * MB, 1 * MB, 0, 0)] == [EventKind.DISK]
    assert monitor.stores_frames
    assert list(monitor.update(60 * MB, 1 * MB, 0, 0))
    assert not monitor.stores_frames
    assert not monitor.is_full
    assert list(monitor.update(10 * MB, 1 * MB, 0, 0))
    assert monitor.is_full
    assert not list(monitor.update(9 * MB, 1 * MB, 0, 0))  # reported once


def test_pictures_come_back_with_room_to_spare():
    monitor = DiskMonitor(reserve_bytes=64 * MB)
    list(monitor.update(60 * MB, 1 * MB, 0, 0))
    assert not list(monitor.update(100 * MB, 1 * MB, 0, 0))  # no flapping at the limit
    (event,) = monitor.update(5_000 * MB, 1 * MB, 0, 0)
    assert (event.severity, "5000 MB" in event.text) == (Severity.INFO, True)
    assert monitor.stores_frames


def test_a_disk_that_recovers_is_warned_of_again():
    monitor = DiskMonitor(reserve_bytes=64 * MB)
    events = [len(list(monitor.update(free * MB, 1 * MB, 0, 0))) for free in (500, 10_000, 500)]
    assert events == [1, 1, 1]  # warned, enough again, warned


def test_pictures_pause_after_an_error_of_storing_and_skipped_frames_are_reported():
    monitor = StorageMonitor()
    assert not monitor.ends_recording(StorageError("ENOSPC"), 100 * S)
    assert [monitor.skips_frame(second * S) for second in (101, 109, 111)] == [True, True, False]
    assert not list(monitor.summary(109 * S, 0))
    (event,) = monitor.summary(111 * S, 0)
    assert event.text.startswith("2 ")
    assert event.text.endswith("ENOSPC")
    assert not list(monitor.summary(112 * S, 0))
    assert not monitor.ends_recording(StorageError("EROFS"), 9999 * S)
    assert [monitor.skips_frame(10_000 * S)] == [True]
    (at_end,) = monitor.summary(10_000 * S, 0, at_end=True)
    assert at_end.text.startswith("1 ")
    assert at_end.text.endswith("EROFS")
    assert not monitor.ends_recording(StorageError("once more, a day later"), 9999 * S)
    assert monitor.ends_recording(StorageError("and once more"), 10_001 * S)


@pytest.mark.parametrize(("step_s", "reported"), [(0.4, False), (0.6, True), (-0.6, True), (3.0, True)])
def test_a_step_of_the_system_clock_of_half_a_second_is_reported(step_s, reported):
    monitor = ClockMonitor()
    assert monitor.update(ClockCheck(0, 10**18, 100), 0)[1] == []
    _, events = monitor.update(ClockCheck(10**9, 10**18 + round(step_s * 1e9), 100), 0)
    assert [event.kind for event in events] == [EventKind.CLOCK_STEP] * reported
    assert all(f"{step_s:+.3f} s" in event.text for event in events)


# --- the monitor, once a second: what follows from the clock comparisons of a recording

SLEPT_S = 660
LUX = header().streams[1]


class Notebook(SimulatedClock):
    """The clock of a computer that can be shut: UTC goes on, the monotonic clock stands."""

    slept_ns = 0

    def shut_for(self, seconds: int) -> None:
        self.slept_ns += seconds * S

    def check(self) -> ClockCheck:
        awake = super().check()
        offset_ns = awake.utc_minus_mono_ns + self.slept_ns
        return replace(awake, utc_minus_mono_ns=offset_ns, suspended_ns=self.slept_ns)


def recorded(path: Path, seconds: int, move: tuple[int, str, int] | None) -> dict[EventKind, int]:
    """A reading and a look around each second; returns the second at which each kind of event came.

    `move` is the second behind which a method of the clock is called, that method, and its seconds.
    """
    kinds = {}
    with Notebook(START_NS) as clock:
        writer = SessionWriter(path, header(), clock)
        monitor = HealthMonitor(clock, (), SampleQueue({}), writer, lambda: 10**12)
        for second in range(seconds):
            writer.append(sample(LUX, second, clock.mono_ns(), clock.to_utc_ns(clock.mono_ns())))
            snapshot = monitor.update()
            assert snapshot is not None
            kinds |= {event.kind: second for event in snapshot.events}
            for check in snapshot.clock_checks:
                writer.put(check)
            if move and second == move[0]:
                getattr(clock, move[1])(move[2])
            clock.sleep(1.0)
        writer.close()
    return kinds


def test_a_drive_that_does_not_answer_for_a_moment_has_as_much_room_as_before(tmp_path):
    answers: list[int | OSError] = [10**12, OSError("stale file handle"), 10**11]

    def free_bytes() -> int:
        answer = answers.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    with SimulatedClock(START_NS) as clock:
        writer = SessionWriter(tmp_path / "a.h5", header(), clock)
        monitor = HealthMonitor(clock, (), SampleQueue({}), writer, free_bytes)
        seen = []
        while answers:
            snapshot = monitor.update()
            assert snapshot is not None
            seen.append(snapshot.health.disk_free_bytes)
            clock.sleep(1.0)
        writer.close()
    assert seen == [10**12, 10**12, 10**11]


@pytest.mark.parametrize(
    ("move", "kind", "stored_s"),
    [
        (None, None, [0, 60, 120]),
        ((99, "shut_for", SLEPT_S), EventKind.SLEPT, [0, 60, 99, 100]),  # known to the second
        ((60, "shut_for", SLEPT_S), EventKind.SLEPT, [0, 60, 61, 121]),  # right after a comparison
        ((99, "step_system_clock", SLEPT_S), EventKind.CLOCK_STEP, [0, 60, 99, 100]),
    ],
)
def test_clocks_are_compared_once_a_minute_and_around_what_moves_them(tmp_path, move, kind, stored_s):
    assert recorded(tmp_path / "a.h5", 130, move) == ({kind: move[0] + 1} if move else {})
    with open_session(tmp_path / "a.h5") as session:
        since_ns = session.stream("lux").column("mono_ns")[0]
        assert [(check.mono_ns - since_ns) // S for check in session.clock_checks()] == stored_s
        steps = propose_time_map(session)
    if kind is EventKind.SLEPT:
        assert [(step.mono_ns, step.add_ns) for step in steps] == [(since_ns + move[0] * S, SLEPT_S * S)]


def test_the_lag_is_that_of_the_latest_sample_since_the_last_look(tmp_path):
    with SimulatedClock(START_NS) as clock:
        writer = SessionWriter(tmp_path / "a.h5", header(), clock)
        monitor = HealthMonitor(clock, (), SampleQueue({}), writer, lambda: 10**12)
        lags = []
        for late_ms in ((30, 5), ()):
            for late in late_ms:
                monitor.sample_arrived(sample(LUX, 0, clock.mono_ns() - late * 1_000_000))
            snapshot = monitor.update()
            assert snapshot is not None
            lags.append(snapshot.health.lag_ms)
            clock.sleep(1.0)
        writer.close()
    assert lags == [30.0, 0.0]
