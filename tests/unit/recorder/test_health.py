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


def test_a_flag_is_told_when_it_begins_not_while_it_lasts() -> None:
    watch = FlagMonitor()
    flags = [Quality.GOOD, Quality.OVERRANGE, Quality.OVERRANGE, Quality.GOOD, Quality.OVERRANGE]
    told = [[event.kind for event in watch.look(reading(flag))] for flag in flags]
    assert told == [[], [EventKind.OVERRANGE], [], [], [EventKind.OVERRANGE]]


def test_garbled_records_are_told_at_most_once_a_minute_with_their_number() -> None:
    watch = GarbleMonitor()
    counts = [(0, 0), (3, 1), (5, 2), (9, 62)]
    told = [[event.data["records"] for event in watch.look("lux", n, s * S, s * S)] for n, s in counts]
    assert told == [[], [3], [], [6]]


def test_garbled_records_of_the_last_minute_are_told_at_the_end() -> None:
    watch = GarbleMonitor()
    (first,) = watch.look("lux", 3, 10 * S, 10 * S)
    assert list(watch.look("lux", 5, 30 * S, 30 * S)) == []
    (last,) = watch.look("lux", 5, 40 * S, 40 * S, at_end=True)
    assert [first.data["records"], last.data["records"]] == [3, 2]
    assert list(watch.look("lux", 5, 41 * S, 41 * S, at_end=True)) == []


def test_a_clock_step_and_a_sleep_are_told_apart() -> None:
    watch = ClockMonitor()
    hour = 3600 * S

    def kinds(utc_minus_mono: int, suspended: int) -> list[EventKind]:
        check = ClockCheck(0, utc_minus_mono, 100, suspended_ns=suspended)
        return [event.kind for event in watch.look(check, 0)]

    assert kinds(0, 0) == []
    assert kinds(S // 10, 0) == []  # the drift of a minute is no step
    assert kinds(hour, 0) == [EventKind.CLOCK_STEP]
    assert kinds(hour + 660 * S, 660 * S) == [EventKind.SLEPT]
    assert kinds(660 * S, 660 * S) == [EventKind.CLOCK_STEP]  # stepped back


def test_a_shrinking_disk_warns_then_stops_pictures_then_asks_to_seal() -> None:
    watch = DiskMonitor(reserve_bytes=64 * MB)
    assert not list(watch.look(10_000 * MB, 1 * MB, 0, 0))
    assert [e.kind for e in watch.look(500 * MB, 1 * MB, 0, 0)] == [EventKind.DISK]
    assert watch.pictures
    assert list(watch.look(60 * MB, 1 * MB, 0, 0))
    assert not watch.pictures
    assert not watch.is_full
    assert list(watch.look(10 * MB, 1 * MB, 0, 0))
    assert watch.is_full
    assert not list(watch.look(9 * MB, 1 * MB, 0, 0))  # told once


def test_pictures_come_back_with_room_to_spare() -> None:
    watch = DiskMonitor(reserve_bytes=64 * MB)
    list(watch.look(60 * MB, 1 * MB, 0, 0))
    assert not list(watch.look(100 * MB, 1 * MB, 0, 0))  # no flapping at the limit
    assert [e.text for e in watch.look(5_000 * MB, 1 * MB, 0, 0)] == ["5000 MB free: pictures on again"]
    assert watch.pictures


def test_a_disk_that_recovers_is_warned_of_again() -> None:
    watch = DiskMonitor(reserve_bytes=64 * MB)
    free = (500, 10_000, 500)
    assert [len(list(watch.look(one * MB, 1 * MB, 0, 0))) for one in free] == [1, 0, 1]


def test_pictures_pause_after_an_error_of_storing_and_what_was_left_out_is_told() -> None:
    watch = StorageMonitor()
    assert not watch.failed(StorageError("database or disk is full"), 100 * S)
    assert [watch.holds(second * S) for second in (101, 109, 111)] == [True, True, False]
    assert not list(watch.over(109 * S, 0))
    (event,) = watch.over(111 * S, 0)
    assert event.text == "2 pictures left out after an error of storing: database or disk is full"
    assert not list(watch.over(112 * S, 0))
    assert not watch.failed(StorageError("again, hours later"), 9999 * S)
    assert [watch.holds(10_000 * S)] == [True]
    (at_end,) = watch.over(10_000 * S, 0, at_end=True)
    assert at_end.text == "1 picture left out after an error of storing: again, hours later"
    assert not watch.failed(StorageError("once more, a day later"), 9999 * S)
    assert watch.failed(StorageError("and once more"), 10_001 * S)


@pytest.mark.parametrize(("step_s", "told"), [(0.4, False), (0.6, True), (-0.6, True), (3.0, True)])
def test_a_step_of_the_system_clock_of_half_a_second_is_told(step_s: float, told: bool) -> None:
    watch = ClockMonitor()
    assert list(watch.look(ClockCheck(0, 10**18, 100), 0)) == []
    events = list(watch.look(ClockCheck(60 * 10**9, 10**18 + round(step_s * 1e9), 100), 0))
    assert [event.kind for event in events] == [EventKind.CLOCK_STEP] * told
    assert all(f"{step_s:+.3f} s" in event.text for event in events)
