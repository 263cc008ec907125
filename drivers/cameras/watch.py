"""What only the pictures around a picture can tell: repeated, frozen, lost before, shutter closed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldkit.drivers.cameras.picture import Picture
from fieldkit.model.device import Buffer
from fieldkit.model.samples import NO_COUNTER, Quality

FROZEN_NS = 3_000_000_000  # longer than any shutter correction holds the picture
SETTLING_NS = 10_000_000_000  # levels creep after a correction
REPEATS_OF_A_SHUTTER = 2  # more than a transport repeats a picture by mistake


class Watch:
    """Remembers just enough of the last pictures; restart it after pictures were let go by."""

    def __init__(self) -> None:
        self._counts: NDArray[np.uint16] | None = None
        self._counter = (NO_COUNTER, NO_COUNTER)
        self._sequence = -1
        self._changed_ns = 0
        self._repeats = 0
        self._settled_ns = -(2**63)

    def restart(self) -> None:
        """Pictures were skipped on purpose: the gap means nothing.

        The last picture is still remembered: the same one again so much later is a frozen one.
        """
        self._sequence = -1
        self._repeats = 0

    def shutter_runs(self, mono_ns: int) -> None:
        """A correction was seen or ordered at `mono_ns`."""
        self._settled_ns = mono_ns + SETTLING_NS

    def look(self, picture: Picture, buffer: Buffer) -> Quality:
        """What the history adds to what the bytes say."""
        quality = self._gap(buffer.sequence)
        if self._is_repeated(picture):
            self._repeats += 1
            quality |= Quality.DUPLICATE
            if buffer.mono_ns - self._changed_ns > FROZEN_NS:
                quality |= Quality.FROZEN
        else:
            self._repeats = 0
            self._changed_ns = buffer.mono_ns
        self._counts = picture.counts
        self._counter = (picture.device_seq, picture.device_time)
        return quality | self._shutter(picture, buffer.mono_ns)

    def _gap(self, sequence: int) -> Quality:
        lost = self._sequence >= 0 and sequence > self._sequence + 1
        self._sequence = sequence
        return Quality.DROPPED_BEFORE if lost else Quality.GOOD

    def _is_repeated(self, picture: Picture) -> bool:
        """By the camera's own counter or clock where it has one, else, and in doubt, by the pixels."""
        counter = (picture.device_seq, picture.device_time)
        if any(new == old != NO_COUNTER for new, old in zip(counter, self._counter, strict=True)):
            return True
        last, now = self._counts, picture.counts
        if last is None or last.shape != now.shape:
            return False
        middle = len(now) // 2  # noise makes one row enough to tell pictures apart
        return np.array_equal(now[middle], last[middle]) and np.array_equal(now, last)

    def _shutter(self, picture: Picture, mono_ns: int) -> Quality:
        """The camera's word if it gives one; else a picture that stands still betrays the shutter."""
        if picture.shutter is None and self._repeats >= REPEATS_OF_A_SHUTTER:
            self.shutter_runs(mono_ns)
        return Quality.SHUTTER if picture.shutter or mono_ns < self._settled_ns else Quality.GOOD
