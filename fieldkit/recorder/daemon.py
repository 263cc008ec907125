"""Work in a thread that may hang: it is left behind then, and neither recording nor program waits for it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from threading import Thread
from typing import TypeVar

T = TypeVar("T")


def start(work: Callable[[], T], name: str) -> Future[T]:
    """Begin to work in a thread of that name; its result, or whatever it raises, once there is one."""
    outcome: Future[T] = Future()
    Thread(target=_run, args=(work, outcome), name=name, daemon=True).start()
    return outcome


def _run(work: Callable[[], T], outcome: Future[T]) -> None:
    try:
        result = work()
    except BaseException as error:  # another package's code may fail in any way, also by SystemExit
        outcome.set_exception(error)
    else:
        outcome.set_result(result)
