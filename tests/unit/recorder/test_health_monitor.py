"""Looking around once a second: what the clock comparisons of a recording say afterwards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from fieldkit.model.clock import ClockCheck
from fieldkit.model.samples import EventKind
from fieldkit.recorder.health import HealthMonitor
from fieldkit.recorder.sample_queue import SampleQueue
from fieldkit.sessions.clock_correction import propose_time_map
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation.simulated_clock import SimulatedClock
from tests.harness.recording import START_NS, header, sample

S = 1_000_000_000
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


def recorded(path: Path, seconds: int, shut_at_s: int) -> list[EventKind]:
    """A reading and a look around each second; returns the kinds of events."""
    kinds = []
    with Notebook(START_NS) as clock:
        writer = SessionWriter(path, header(), clock)
        monitor = HealthMonitor(clock, (), SampleQueue({}), writer, lambda: 10**12)
        for second in range(seconds):
            writer.append(sample(LUX, second, clock.mono_ns(), clock.to_utc_ns(clock.mono_ns())))
            snapshot = monitor.update()
            assert snapshot is not None
            kinds += [event.kind for event in snapshot.events]
            for check in snapshot.clock_checks:
                writer.clock_check(check)
            if second == shut_at_s:
                clock.shut_for(SLEPT_S)
            clock.sleep(1.0)
        writer.close()
    return kinds


def test_a_drive_that_does_not_answer_for_a_moment_has_as_much_room_as_before(tmp_path: Path) -> None:
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


def test_clocks_are_compared_once_a_minute(tmp_path: Path) -> None:
    assert recorded(tmp_path / "a.h5", 130, shut_at_s=999) == []
    with open_session(tmp_path / "a.h5") as session:
        since_ns = session.stream("lux").column("mono_ns")[0]
        assert [(check.mono_ns - since_ns) // S for check in session.clock_checks()] == [0, 60, 120]


def test_a_sleep_between_two_minutes_is_known_to_the_second(tmp_path: Path) -> None:
    assert recorded(tmp_path / "a.h5", 130, shut_at_s=99) == [EventKind.SLEPT]
    with open_session(tmp_path / "a.h5") as session:
        since_ns = session.stream("lux").column("mono_ns")[0]
        assert [(check.mono_ns - since_ns) // S for check in session.clock_checks()] == [0, 60, 99, 100]
        (step,) = propose_time_map(session)
    assert (step.mono_ns, step.add_ns) == (since_ns + 99 * S, SLEPT_S * S)


def test_a_sleep_right_after_a_comparison_needs_only_one_more(tmp_path: Path) -> None:
    recorded(tmp_path / "a.h5", 70, shut_at_s=60)
    with open_session(tmp_path / "a.h5") as session:
        since_ns = session.stream("lux").column("mono_ns")[0]
        assert [(check.mono_ns - since_ns) // S for check in session.clock_checks()] == [0, 60, 61]


def test_the_lag_is_that_of_the_latest_sample_since_the_last_look(tmp_path: Path) -> None:
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
