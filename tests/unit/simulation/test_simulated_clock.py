import contextlib
import os
import select
import threading
import time
import tty
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from fieldkit.model.units import SECOND_NS
from fieldkit.simulation.simulated_clock import START_MONO_NS, SimulatedClock

NOON_NS = 1_451_674_800_000_000_000


@pytest.fixture
def clock():
    with SimulatedClock(NOON_NS) as clock:
        yield clock


def work(clock, *jobs):
    """Threads that take part, one for each job; time stands until all of them have joined."""
    joined, pool = threading.Barrier(len(jobs) + 1), ThreadPoolExecutor(len(jobs))

    def take_part(job):
        with clock.taking_part():
            joined.wait()
            job()

    with clock.taking_part():
        running = [pool.submit(take_part, job) for job in jobs]
        joined.wait()
    for each in running:
        each.result(60.0)
    pool.shutdown()


@contextlib.contextmanager
def instrument(clock, answer_after_ns=30_000_000):
    """A pseudo-terminal whose far end answers each request `?` with the time it was heard."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)

    def heard():
        os.read(master, 100)
        answer = b"%d\n" % clock.mono_ns()
        clock.call_at(clock.mono_ns() + answer_after_ns, lambda: say(answer))

    def say(answer):
        os.write(master, answer)
        assert select.select([slave], [], [], 5.0)[0], "the kernel did not deliver"

    clock.watch(master, heard)
    try:
        yield slave
    finally:
        clock.forget(master)
        os.close(master)
        os.close(slave)


def test_time_stands_while_nobody_waits(clock):
    before = clock.mono_ns()
    time.sleep(0.01)  # real time passes alone
    assert clock.mono_ns() == before == START_MONO_NS


def test_sleep_of_nothing_returns_at_once(clock):
    clock.sleep(0.0)
    clock.sleep(-1.0)
    clock.sleep_until(0)
    assert clock.mono_ns() == START_MONO_NS


def test_utc_follows_the_anchor_and_not_a_step_of_the_system_clock(clock):
    anchor = clock.check()
    clock.sleep(10.0)
    clock.step_system_clock(3600.0)
    assert clock.to_utc_ns(clock.mono_ns()) == NOON_NS + 10 * SECOND_NS
    assert clock.to_mono_ns(NOON_NS) == START_MONO_NS
    assert clock.check().utc_minus_mono_ns - anchor.utc_minus_mono_ns == 3600 * SECOND_NS


def test_time_stands_while_somebody_who_takes_part_is_at_work(clock):
    seen = []

    def at_work():
        before = clock.mono_ns()
        time.sleep(0.05)  # work: real time passes alone
        seen.append(clock.mono_ns() - before)

    work(clock, lambda: clock.sleep(1e6), at_work)
    assert seen == [0]


def test_whoever_leaves_or_dies_is_not_waited_for(clock):
    def dies():
        clock.sleep(1.0)
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        work(clock, lambda: clock.sleep(1000.0), dies)
    assert clock.mono_ns() == START_MONO_NS + 1000 * SECOND_NS


def test_bytes_end_a_wait_at_the_time_they_are_sent(clock):
    end, start = os.pipe()
    clock.call_at(START_MONO_NS + 3 * SECOND_NS, lambda: os.write(start, b"x"))
    assert not clock.wait_readable(end, 1.0)
    assert clock.mono_ns() == START_MONO_NS + SECOND_NS
    assert clock.wait_readable(end, 10.0)
    assert clock.mono_ns() == START_MONO_NS + 3 * SECOND_NS
    assert clock.wait_readable(end, 0.0), "still unread"
    os.close(start)
    os.read(end, 1)
    assert clock.wait_readable(end, 10.0), "hung up counts as readable, the read then tells"
    os.close(end)


def test_request_and_answer_take_the_same_time_however_busy_the_computer(clock):
    asked = [
        [START_MONO_NS + round(turn * every_s * SECOND_NS) for turn in range(40)]
        for every_s in (0.5, 0.6, 0.7)
    ]
    heard = [[] for _ in asked]

    def driver(fd, asked, heard):
        for at_ns in asked:
            clock.sleep_until(at_ns)
            os.write(fd, b"?")
            assert clock.wait_readable(fd, 0.2), "no answer"
            heard.append((int(os.read(fd, 100)), clock.mono_ns()))

    with contextlib.ExitStack() as stack:
        drivers = [
            partial(driver, stack.enter_context(instrument(clock)), *times)
            for times in zip(asked, heard, strict=True)
        ]
        work(clock, *drivers)
    assert heard == [[(at_ns, at_ns + 30_000_000) for at_ns in times] for times in asked]


def test_failure_of_an_instrument_is_told_to_whoever_waits(clock, caplog):
    def fail():
        raise ZeroDivisionError("broken far end")

    clock.call_at(START_MONO_NS + SECOND_NS, fail)
    for _ in range(2):
        with pytest.raises(RuntimeError) as caught:
            clock.sleep(10.0)
        assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert "failed" in caplog.text


def test_speed_keeps_scene_time_from_running_ahead():
    with SimulatedClock(NOON_NS, speed=100.0) as clock:
        real = time.monotonic()
        clock.sleep(10.0)
        assert time.monotonic() - real >= 0.1
        assert clock.mono_ns() == START_MONO_NS + 10 * SECOND_NS


def test_speed_must_be_positive():
    with pytest.raises(ValueError, match="speed"):
        SimulatedClock(NOON_NS, speed=0.0)
