"""A clock whose time advances only when every participating thread waits.

Threads that read instruments wait by their clock alone (`fieldkit.model.clock`). When all participants wait,
this one jumps to the next event: a simulated instrument acts (`call_at`), bytes arrive (`watch`,
`wait_readable`), or a wait ends. However slow or loaded the computer, the same program sees the same times:
a day of field work runs in seconds and twice the same. `speed` limits the jumps to a multiple of real time,
for watching.

The thread that waits last moves time, from within its wait: it takes one step after the other until a wait is
over. If that is its own, it returns without any switch of threads; otherwise it releases the other thread and
waits until it is released itself. Waits that end together end one after the other, in the order of deadline
and thread name. Instruments and scenes are not known here.

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


@dataclass(eq=False, slots=True)
class _Waiter:
    """One waiting thread: until when, for which descriptor, and what became of it.

    It looks again at its `turn`: its wait is over, or it is to move time.
    """

    deadline_ns: float
    thread: str
    fd: int | None
    turn: threading.Event = field(default_factory=threading.Event)
    is_over: bool = False
    is_readable: bool = False


class SimulatedClock:
    """Scene time for all threads from a UTC start on; satisfies `fieldkit.model.clock.Clock`.

    `speed` is seconds of the scene per real second; infinite: as fast as the work allows.
    `elapsed_ns` is how far the scene is already.
    """

    is_real = False

    def __init__(self, start_utc_ns: int, speed: float = math.inf, elapsed_ns: int = 0) -> None:
        if not speed > 0:
            raise ValueError(f"speed must be positive, not {speed}")
        self._now = START_MONO_NS + elapsed_ns
        self._utc_minus_mono_ns = start_utc_ns - START_MONO_NS
        self._system_step_ns = 0
        self._speed = speed
        self._real_start: float | None = None
        self._lock = threading.Lock()  # guards what follows; never held while an instrument acts
        self._taking_part: dict[int, int] = {}
        self._waiters: dict[int, _Waiter] = {}
        self._calls: list[tuple[int, int, Callable[[], None]]] = []
        self._call_number = itertools.count()
        self._watches: dict[int, Callable[[], None]] = {}
        self._holds: list[Callable[[float], bool]] = []
        self._mover: int | None = None  # the thread that moves time now
        self._closed = False
        self._failure: BaseException | None = None

    # --- the clock of the recorder

    def mono_ns(self) -> int:
        """Scene time on the monotonic scale; starts at 1000 s."""
        return self._now

    def take_anchor(self) -> None:
        """Nothing to do: simulated clocks go alike."""

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
        with self._lock:
            self._taking_part[me] = self._taking_part.get(me, 0) + 1
        try:
            yield
        finally:
            with self._lock:
                self._taking_part[me] -= 1
                if not self._taking_part[me]:
                    del self._taking_part[me]
                self._wake_a_mover()

    def hold_until(self, settled: Callable[[float], bool]) -> None:
        """Hold time until `settled(timeout_s)`, which waits at most that long; asked before each advance."""
        with self._lock:
            self._holds.append(settled)

    def close(self) -> None:
        """Wake all threads; from then on waits end at once and time runs freely."""
        with self._lock:
            self._closed = True
            for waiter in self._waiters.values():
                waiter.turn.set()

    def __enter__(self) -> SimulatedClock:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- for simulated instruments

    def call_at(self, mono_ns: int, act: Callable[[], None]) -> None:
        """Run `act` at that time, in whichever thread moves time then, before any waiting thread wakes."""
        with self._lock:
            # the number puts calls of one time in order, and keeps functions from being compared
            heapq.heappush(self._calls, (mono_ns, next(self._call_number), act))

    def watch(self, fd: int, on_bytes: Callable[[], None]) -> None:
        """Run `on_bytes`, which reads them, whenever bytes arrive at an instrument's end `fd`.

        Time does not advance before a written request has been received: Linux delivers what is still in
        flight in a pseudo-terminal when its end is polled.
        """
        with self._lock:
            self._watches[fd] = on_bytes

    def forget(self, fd: int) -> None:
        """End a `watch`; call it before closing the descriptor."""
        with self._lock:
            del self._watches[fd]

    # --- waiting threads

    def _after(self, seconds: float) -> float:
        """Monotonic time that many seconds from now, a whole number unless it is never."""
        return self._now + round(seconds * SECOND_NS) if math.isfinite(seconds) else math.inf

    def _wait(self, deadline_ns: float, fd: int | None) -> bool:
        """Wait until the deadline or for bytes, and move time if all others wait; whether bytes came."""
        me = threading.get_ident()
        waiter = _Waiter(deadline_ns, threading.current_thread().name, fd)
        with self._lock:
            self._waiters[me] = waiter
        try:
            while not (waiter.is_over or self._closed):
                if self._is_mover(me):
                    self._one_step()
                else:
                    waiter.turn.wait()
                    waiter.turn.clear()
        finally:  # also when a signal ends the wait
            with self._lock:
                self._waiters.pop(me, None)
                if self._mover == me:
                    self._mover = None
                self._wake_a_mover()
        return waiter.is_readable if waiter.is_over else self._wait_no_more(waiter)

    def _wait_no_more(self, waiter: _Waiter) -> bool:
        """After `close`: let time run so that loops with a deadline end."""
        if self._failure is not None:
            raise RuntimeError("a simulated instrument failed") from self._failure
        # a loop that waits again at once would keep a core busy
        time.sleep(0.001)
        if waiter.fd is not None and _is_readable(waiter.fd):
            return True
        if math.isfinite(waiter.deadline_ns):
            self._now = max(self._now, round(waiter.deadline_ns))
        return False

    # --- which thread moves time

    def _is_mover(self, me: int) -> bool:
        """True if a waiting thread is to move time: all others wait, and none of them does."""
        with self._lock:
            if self._mover is None and self._all_wait():
                self._mover = me
            elif self._mover == me and not self._all_wait():
                self._mover = None
            return self._mover == me

    def _wake_a_mover(self) -> None:
        """Once all that are left wait, let one move time: none will come and wait last. Needs the lock."""
        if self._mover is None and self._all_wait():
            next(iter(self._waiters.values())).turn.set()

    def _all_wait(self) -> bool:
        return bool(self._waiters) and self._taking_part.keys() <= self._waiters.keys()

    # --- steps of time, taken by the thread that moves it

    def _one_step(self) -> None:
        """The earliest of: bytes at an instrument, bytes for a driver, a call, a deadline."""
        self._hold()
        if self._closed:
            return
        with self._lock:
            waited_for = [waiter.fd for waiter in self._waiters.values() if waiter.fd is not None]
            ready = _readable((*self._watches, *waited_for))
        if ready and (self._deliver_requests(ready) or self._release_readable(ready)):
            return
        with self._lock:
            next_ns = min((waiter.deadline_ns for waiter in self._waiters.values()), default=math.inf)
            if self._calls:
                next_ns = min(next_ns, self._calls[0][0])
        if not self._may_move_to(next_ns):
            return
        # a deadline that is over must not turn time back
        self._now = max(self._now, round(next_ns))
        if not self._run_call():
            self._release_due()

    def _hold(self) -> None:
        """Wait while a thread that `hold_until` declares is busy."""
        while not (all(settled(_CLOSED_AGAIN_S) for settled in self._holds) or self._closed):
            pass

    def _deliver_requests(self, ready: set[int]) -> bool:
        """Let instruments read what has arrived at their end; whether anything had."""
        with self._lock:
            callbacks = [self._watches[fd] for fd in sorted(ready & self._watches.keys())]
        for on_bytes in callbacks:
            self._act(on_bytes)
        return bool(callbacks)

    def _release_readable(self, ready: set[int]) -> bool:
        """Release the first thread by name whose bytes have arrived; whether there was one."""
        with self._lock:
            ended = [
                (waiter.thread, thread) for thread, waiter in self._waiters.items() if waiter.fd in ready
            ]
            if ended:
                # one at a time, by name: in an order that no scheduler decides
                self._release(min(ended)[1], is_readable=True)
        return bool(ended)

    def _may_move_to(self, next_ns: float) -> bool:
        """True if real time has reached it; if not, let a little pass."""
        if math.isinf(self._speed) and math.isfinite(next_ns):
            return True
        if self._real_start is None:
            self._real_start = time.monotonic() - self._elapsed_s(self._now)
        due = self._real_start + self._elapsed_s(next_ns)
        left_s = due - time.monotonic()
        if left_s > 0:
            time.sleep(min(left_s, _POLL_S))
        return left_s <= 0

    def _elapsed_s(self, mono_ns: float) -> float:
        """Real seconds of a monotonic time; infinite for a time that never comes."""
        return (mono_ns - START_MONO_NS) / SECOND_NS / self._speed if math.isfinite(mono_ns) else math.inf

    def _run_call(self) -> bool:
        with self._lock:
            if not self._calls or self._calls[0][0] > self._now:
                return False
            _, _, act = heapq.heappop(self._calls)
        self._act(act)
        return True

    def _release_due(self) -> None:
        with self._lock:
            due = [
                (waiter.deadline_ns, waiter.thread, thread)
                for thread, waiter in self._waiters.items()
                if waiter.deadline_ns <= self._now
            ]
            if due:
                self._release(min(due)[2])

    def _release(self, thread: int, *, is_readable: bool = False) -> None:
        """End a thread's wait. Needs the lock."""
        waiter = self._waiters.pop(thread)
        waiter.is_readable, waiter.is_over = is_readable, True
        waiter.turn.set()

    def _act(self, act: Callable[[], None]) -> None:
        """Let an instrument act; its failure is raised in every waiting thread."""
        try:
            act()
        except Exception as failure:
            log.exception("a simulated instrument failed")
            self._failure = failure
            self.close()


def _readable(fds: Iterable[int]) -> set[int]:
    """Those from which a read would not block: bytes, end of file, hung up, or not open at all."""
    poll = select.poll()
    for fd in fds:
        poll.register(fd, select.POLLIN)
    return {fd for fd, _ in poll.poll(0)}


def _is_readable(fd: int) -> bool:
    return bool(_readable((fd,)))
