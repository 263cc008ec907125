"""A clock whose time advances only when every participating thread waits.

Threads that read instruments wait by their clock alone (`fieldkit.model.clock`). When all participants wait,
this one jumps to the next event: a simulated instrument acts (`call_at`), bytes arrive (`watch`,
`wait_readable`), or a wait ends. However slow or loaded the computer, the same program sees the same times:
a day of field work runs in seconds and twice the same. `speed` limits the jumps to a multiple of real time,
for watching.

One thread of the clock advances time; it releases one waiting thread at a time, in the order of deadline and
thread name, and waits until that one waits again. Instruments and scenes are not known here.

Time does not wait for work that neither takes part nor is declared by `hold_until`: start reading threads
while the starting one takes part, and wait until they have joined.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import math
import select
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from fieldkit.model.clock import ClockCheck
from fieldkit.model.units import SECOND_NS

log: logging.Logger = logging.getLogger(__name__)

START_MONO_NS = 1000 * SECOND_NS
_CHECK_ERROR_NS = 200
_CLOSED_AGAIN_S = 0.1  # how often a held clock checks whether it was closed
_POLL_S = 0.02  # how often descriptors are polled while real time has to pass


def _closed_gate() -> threading.Lock:
    """A lock that is held: acquiring it again waits until it is released, at less cost than an event."""
    gate = threading.Lock()
    gate.acquire()
    return gate


@dataclass(eq=False, slots=True)
class _Waiter:
    """One waiting thread."""

    deadline_ns: float
    thread: str
    fd: int | None
    gate: threading.Lock = field(default_factory=_closed_gate)
    readable: bool = False

    def go(self) -> None:
        """Release the thread; a second call does nothing."""
        if self.gate.locked():
            self.gate.release()


class SimulatedClock:
    """Scene time for all threads; satisfies `fieldkit.model.clock.Clock`.

    Parameters
    ----------
    start_utc_ns
        UTC at the start, nanoseconds since 1970.
    speed
        Seconds of the scene per real second; infinite: as fast as the work allows.
    """

    is_real = False

    def __init__(self, start_utc_ns: int, speed: float = math.inf) -> None:
        if not speed > 0:
            raise ValueError(f"speed must be positive, not {speed}")
        self._now = START_MONO_NS
        self._utc_minus_mono_ns = start_utc_ns - START_MONO_NS
        self._system_step_ns = 0
        self._speed = speed
        self._real_start: float | None = None
        self._changed = threading.Condition()
        self._taking_part: dict[int, int] = {}
        self._waiters: dict[int, _Waiter] = {}
        self._calls: list[tuple[int, int, Callable[[], None]]] = []
        self._call_number = itertools.count()
        self._watches: dict[int, Callable[[], None]] = {}
        self._holds: list[Callable[[float], bool]] = []
        self._mover: threading.Thread | None = None
        self._closed = False
        self._failure: BaseException | None = None

    # --- the clock of the recorder

    def mono_ns(self) -> int:
        """Scene time on the monotonic scale; starts at 1000 s."""
        return self._now

    def to_utc_ns(self, mono_ns: int) -> int:
        """UTC nanoseconds since 1970 by the anchor of the start."""
        return mono_ns + self._utc_minus_mono_ns

    def to_mono_ns(self, utc_ns: int) -> int:
        """Monotonic time of an UTC time; inverse of `to_utc_ns`."""
        return utc_ns - self._utc_minus_mono_ns

    def check(self) -> ClockCheck:
        """The system clock's current state, which `step_system_clock` may have set wrong."""
        return ClockCheck(self._now, self._utc_minus_mono_ns + self._system_step_ns, _CHECK_ERROR_NS)

    def step_system_clock(self, seconds: float) -> None:
        """Step the system's UTC forward; recorded stamps do not follow, `check` shows the step."""
        self._system_step_ns += round(seconds * SECOND_NS)

    def sleep(self, seconds: float) -> None:
        """Wait; time also waits for a sleeping thread that does not take part."""
        if seconds > 0:
            self._wait(self._after(seconds), None)

    def sleep_until(self, mono_ns: int) -> None:
        """Wait until a monotonic time."""
        if mono_ns > self._now:
            self._wait(mono_ns, None)

    def wait_readable(self, fd: int, timeout_s: float) -> bool:
        """Wait until `fd` has bytes to read or is hung up; False if nothing came within `timeout_s`."""
        if _is_readable(fd):
            return True
        return timeout_s > 0 and self._wait(self._after(timeout_s), fd)

    @contextmanager
    def taking_part(self) -> Iterator[None]:
        """Hold time while the thread inside works and does not wait; may be nested."""
        me = threading.get_ident()
        with self._changed:
            self._taking_part[me] = self._taking_part.get(me, 0) + 1
        try:
            yield
        finally:
            with self._changed:
                self._taking_part[me] -= 1
                if not self._taking_part[me]:
                    del self._taking_part[me]
                self._changed.notify_all()

    def hold_until(self, settled: Callable[[float], bool]) -> None:
        """Hold time until `settled(timeout_s)`, which waits at most that long; asked before each advance."""
        with self._changed:
            self._holds.append(settled)

    def close(self) -> None:
        """Wake all threads; from then on waits end at once and time runs freely."""
        with self._changed:
            self._closed = True
            for waiter in self._waiters.values():
                waiter.go()
            self._changed.notify_all()
        if self._mover is not None and self._mover is not threading.current_thread():
            self._mover.join()

    def __enter__(self) -> SimulatedClock:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- for simulated instruments

    def call_at(self, mono_ns: int, act: Callable[[], None]) -> None:
        """Run `act` at that time, on the clock's own thread, before any waiting thread wakes."""
        with self._changed:
            heapq.heappush(self._calls, (mono_ns, next(self._call_number), act))
            self._changed.notify_all()

    def watch(self, fd: int, on_bytes: Callable[[], None]) -> None:
        """Run `on_bytes`, which reads them, whenever bytes arrive at an instrument's end `fd`.

        Time does not advance before a written request has been received: Linux delivers what is still in
        flight in a pseudo-terminal when its end is polled.
        """
        with self._changed:
            self._watches[fd] = on_bytes

    def forget(self, fd: int) -> None:
        """End a `watch`; call it before closing the descriptor."""
        with self._changed:
            del self._watches[fd]

    # --- waiting threads

    def _after(self, seconds: float) -> float:
        """Monotonic time that many seconds from now, a whole number unless it is never."""
        return self._now + round(seconds * SECOND_NS) if math.isfinite(seconds) else math.inf

    def _wait(self, deadline_ns: float, fd: int | None) -> bool:
        me = threading.get_ident()
        waiter = _Waiter(deadline_ns, threading.current_thread().name, fd)
        with self._changed:
            if not self._closed:
                self._waiters[me] = waiter
                self._start_mover()
                self._changed.notify_all()
        try:
            if self._closed:
                return self._wait_no_more(waiter)
            waiter.gate.acquire()
            self._raise_failure()
            return waiter.readable
        finally:  # also when a signal ends the wait
            with self._changed:
                self._waiters.pop(me, None)

    def _wait_no_more(self, waiter: _Waiter) -> bool:
        """After `close`: let time run so that loops with a deadline end."""
        self._raise_failure()
        time.sleep(0.001)
        if waiter.fd is not None and _is_readable(waiter.fd):
            return True
        if math.isfinite(waiter.deadline_ns):
            self._now = max(self._now, round(waiter.deadline_ns))
        return False

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise RuntimeError("a simulated instrument failed") from self._failure

    # --- the thread that moves time

    def _start_mover(self) -> None:
        if self._mover is None:
            self._mover = threading.Thread(target=self._move, name="simulated-clock", daemon=True)
            self._mover.start()

    def _move(self) -> None:
        try:
            while not self._closed:
                with self._changed:
                    self._changed.wait_for(lambda: self._closed or self._all_wait())
                if not self._closed:
                    self._one_step()
        except BaseException as failure:  # raised in every waiting thread
            log.exception("a simulated instrument failed")
            self._failure = failure
            self.close()

    def _all_wait(self) -> bool:
        return bool(self._waiters) and all(thread in self._waiters for thread in self._taking_part)

    def _one_step(self) -> None:
        """The earliest of: bytes at an instrument, bytes for a driver, a call, a deadline."""
        with self._changed:
            waited_for = [waiter.fd for waiter in self._waiters.values() if waiter.fd is not None]
            ready = _readable((*self._watches, *waited_for))
        if self._deliver_requests(ready) or self._release_readable(ready) or self._is_held():
            return
        with self._changed:
            calls = [self._calls[0][0]] if self._calls else []
            deadlines = [waiter.deadline_ns for waiter in self._waiters.values()]
        next_ns = max(self._now, min(calls + deadlines, default=math.inf))
        if not self._may_move_to(next_ns):
            return
        self._now = round(next_ns)
        if not self._run_call():
            self._release_due()

    def _deliver_requests(self, ready: set[int]) -> bool:
        """Let instruments read what has arrived at their end; whether anything had."""
        with self._changed:
            callbacks = [self._watches[fd] for fd in sorted(ready & self._watches.keys())]
        for on_bytes in callbacks:
            on_bytes()
        return bool(callbacks)

    def _release_readable(self, ready: set[int]) -> bool:
        """Release the first thread by name whose bytes have arrived; whether there was one."""
        with self._changed:
            ended = [
                (waiter.thread, thread) for thread, waiter in self._waiters.items() if waiter.fd in ready
            ]
            if not ended:
                return False
            waiter = self._waiters.pop(min(ended)[1])
        waiter.readable = True
        waiter.go()
        return True

    def _is_held(self) -> bool:
        """Wait while a thread is busy; whether one was."""
        unsettled = [settled for settled in tuple(self._holds) if not settled(0.0)]
        for settled in unsettled:
            while not (settled(_CLOSED_AGAIN_S) or self._closed):
                pass
        return bool(unsettled)

    def _may_move_to(self, next_ns: float) -> bool:
        """Whether real time has reached it; if not, let a little pass."""
        if self._real_start is None:
            self._real_start = time.monotonic() - self._elapsed_s(self._now)
        due = self._real_start + self._elapsed_s(next_ns)
        left_s = due - time.monotonic()
        if left_s <= 0:
            return True
        with self._changed:
            self._changed.wait(min(left_s, _POLL_S))
        return False

    def _elapsed_s(self, mono_ns: float) -> float:
        """Real seconds of a monotonic time; zero at full speed, infinite for a time that never comes."""
        if math.isinf(mono_ns):
            return math.inf
        return (mono_ns - START_MONO_NS) / SECOND_NS / self._speed

    def _run_call(self) -> bool:
        with self._changed:
            if not self._calls or self._calls[0][0] > self._now:
                return False
            _, _, act = heapq.heappop(self._calls)
        act()
        return True

    def _release_due(self) -> None:
        with self._changed:
            due = [
                (waiter.deadline_ns, waiter.thread, thread)
                for thread, waiter in self._waiters.items()
                if waiter.deadline_ns <= self._now
            ]
            if due:
                self._waiters.pop(min(due)[2]).go()


def _readable(fds: Iterable[int]) -> set[int]:
    """Those from which a read would not block: bytes, end of file, hung up, or not open at all."""
    poll = select.poll()
    for fd in fds:
        poll.register(fd, select.POLLIN)
    return {fd for fd, _ in poll.poll(0)}


def _is_readable(fd: int) -> bool:
    return bool(_readable((fd,)))
