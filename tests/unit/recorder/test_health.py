from __future__ import annotations

import pytest

from fieldkit.model.clock import ClockCheck
from fieldkit.model.errors import StorageError
from fieldkit.model.samples import EventKind, Quality, Reading
from fieldkit.recorder.health import ClockMonitor, DiskMonitor, FlagMonitor, GarbleMonitor, StorageMonitor

S = 1_000_000_000
MB = 1_000_000


def reading(quality: Quality) -> Reading:
    return Reading("lux", 0, 0, (1.0,), quality=quality)


def test_a_flag_is_reported_when_it_begins_not_while_it_lasts() -> None:
    monitor = FlagMonitor()
    flags = [Quality.GOOD, Quality.OVERRANGE, Quality.OVERRANGE, Quality.GOOD, Quality.OVERRANGE]
    reported = [[event.kind for event in monitor.update(reading(flag))] for flag in flags]
    assert reported == [[], [EventKind.OVERRANGE], [], [], [EventKind.OVERRANGE]]


def test_garbled_records_are_reported_at_most_once_a_minute_with_their_number() -> None:
    monitor = GarbleMonitor()
    counts = [(0, 0), (3, 1), (5, 2), (9, 62)]  # records, seconds
    reported = [
        [event.data["records"] for event in monitor.update("lux", n, s * S, s * S)] for n, s in counts
    ]
    assert reported == [[], [3], [], [6]]


def test_garbled_records_of_the_last_minute_are_reported_at_the_end() -> None:
    monitor = GarbleMonitor()
    (first,) = monitor.update("lux", 3, 10 * S, 10 * S)
    assert list(monitor.update("lux", 5, 30 * S, 30 * S)) == []
    (last,) = monitor.update("lux", 5, 40 * S, 40 * S, at_end=True)
    assert [first.data["records"], last.data["records"]] == [3, 2]
    assert list(monitor.update("lux", 5, 41 * S, 41 * S, at_end=True)) == []


def test_a_clock_step_and_a_sleep_are_reported_apart() -> None:
    monitor = ClockMonitor()
    hour = 3600 * S

    def kinds(utc_minus_mono: int, suspended: int) -> list[EventKind]:
        check = ClockCheck(0, utc_minus_mono, 100, suspended_ns=suspended)
        return [event.kind for event in monitor.update(check, 0)]

    assert kinds(0, 0) == []
    assert kinds(S // 10, 0) == []  # the drift of a minute is no step
    assert kinds(hour, 0) == [EventKind.CLOCK_STEP]
    assert kinds(hour + 660 * S, 660 * S) == [EventKind.SLEPT]
    assert kinds(660 * S, 660 * S) == [EventKind.CLOCK_STEP]  # stepped back


def test_a_shrinking_disk_warns_then_stops_pictures_then_asks_to_seal() -> None:
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


def test_pictures_come_back_with_room_to_spare() -> None:
    monitor = DiskMonitor(reserve_bytes=64 * MB)
    list(monitor.update(60 * MB, 1 * MB, 0, 0))
    assert not list(monitor.update(100 * MB, 1 * MB, 0, 0))  # no flapping at the limit
    assert [e.text for e in monitor.update(5_000 * MB, 1 * MB, 0, 0)] == ["5000 MB free: frames on again"]
    assert monitor.stores_frames


def test_a_disk_that_recovers_is_warned_of_again() -> None:
    monitor = DiskMonitor(reserve_bytes=64 * MB)
    free = (500, 10_000, 500)
    assert [len(list(monitor.update(one * MB, 1 * MB, 0, 0))) for one in free] == [1, 0, 1]


def test_pictures_pause_after_an_error_of_storing_and_skipped_frames_are_reported() -> None:
    monitor = StorageMonitor()
    assert not monitor.failed(StorageError("database or disk is full"), 100 * S)
    assert [monitor.skips_frame(second * S) for second in (101, 109, 111)] == [True, True, False]
    assert not list(monitor.summary(109 * S, 0))
    (event,) = monitor.summary(111 * S, 0)
    assert event.text == "2 frames skipped after a storage error: database or disk is full"
    assert not list(monitor.summary(112 * S, 0))
    assert not monitor.failed(StorageError("again, hours later"), 9999 * S)
    assert [monitor.skips_frame(10_000 * S)] == [True]
    (at_end,) = monitor.summary(10_000 * S, 0, at_end=True)
    assert at_end.text == "1 frame skipped after a storage error: again, hours later"
    assert not monitor.failed(StorageError("once more, a day later"), 9999 * S)
    assert monitor.failed(StorageError("and once more"), 10_001 * S)


@pytest.mark.parametrize(("step_s", "reported"), [(0.4, False), (0.6, True), (-0.6, True), (3.0, True)])
def test_a_step_of_the_system_clock_of_half_a_second_is_reported(step_s: float, reported: bool) -> None:
    monitor = ClockMonitor()
    assert list(monitor.update(ClockCheck(0, 10**18, 100), 0)) == []
    events = list(monitor.update(ClockCheck(60 * 10**9, 10**18 + round(step_s * 1e9), 100), 0))
    assert [event.kind for event in events] == [EventKind.CLOCK_STEP] * reported
    assert all(f"{step_s:+.3f} s" in event.text for event in events)
