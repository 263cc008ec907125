"""Which of the pictures sent arrived, and when a loss proves nothing."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import TypeVar

import pytest

T = TypeVar("T")
LITTLE = 0.05  # of the guest's processors idle: hardly ever


def places_in(sent: Sequence[int], received: Sequence[int]) -> list[int]:
    """Which of the pictures sent each one received is, by checksum and in order.

    Raises `ValueError` for one that was never sent, or comes before one sent earlier.
    """
    found, after = [], 0
    for checksum in received:
        found.append(sent.index(checksum, after))
        after = found[-1] + 1
    return found


def skipped(numbers: Sequence[int]) -> int:
    """How many are missing between the first and the last of ascending numbers."""
    return numbers[-1] - numbers[0] + 1 - len(numbers)


def first_without_loss(attempt: Callable[[], tuple[T, int]], tries: int = 5) -> T:
    """What the first attempt without a loss gave; an attempt gives its result and what it lost.

    The emulator itself drops isochronous packets when it gets no processor for a while; an attempt may ask
    less of it than the one before, for fieldkit would lose every time.
    """
    losses = []
    for _ in range(tries):
        result, lost = attempt()
        losses.append(lost)
        if lost == 0:
            break
    nothing_lost(lost, told=[f"attempts lost {losses}"])
    return result


def nothing_lost(lost: int, idle_share: float = 1.0, told: Sequence[str] = ()) -> None:
    """Assert that nothing was lost; where no processor time was left, skip instead of accusing fieldkit.

    `idle_share` is of the guest's processors, `told` what the recorder said of it. The lab alone keeps the
    load of this computer below three. In continuous integration the skip is a failure.
    """
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if lost and (load > cores + 1 or idle_share < LITTLE):
        pytest.skip(
            f"{lost} lost where no processor time was left: "
            f"a load of {load:.1f} on {cores} cores, {idle_share:.2f} of the guest idle"
        )
    assert lost == 0, f"{idle_share:.2f} of the guest was idle; {told}"
