"""Signals that end a recording, which is then sealed; a second one stops at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager


def stop_on_signals() -> AbstractContextManager[threading.Event]:
    """An event that Ctrl-C, SIGTERM and SIGHUP set; a second Ctrl-C or SIGTERM raises `KeyboardInterrupt`."""
    return _stopped_by([signal.SIGINT, signal.SIGTERM, signal.SIGHUP])


@contextmanager
def _stopped_by(signals: Sequence[signal.Signals]) -> Iterator[threading.Event]:
    """An event that the first of these signals sets; the second raises `KeyboardInterrupt`."""
    stopping = threading.Event()

    def stop(number: int, frame: object) -> None:
        if number != signal.SIGHUP:  # shell and kernel both send one when a terminal closes
            for second in {*signals} - {signal.SIGHUP}:
                signal.signal(second, signal.default_int_handler)
        stopping.set()

    before = {number: signal.signal(number, stop) for number in signals}
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def stopped_by_interrupt() -> Iterator[threading.Event]:
    """An event that the first interrupt sets, where Python alone would raise `KeyboardInterrupt`."""
    is_main = threading.current_thread() is threading.main_thread()
    is_plain = is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with _stopped_by([signal.SIGINT] if is_plain else []) as stopping:
        yield stopping
