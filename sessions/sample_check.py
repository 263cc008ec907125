"""What each stream of a session promised, against what comes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Frame, Sample
from fieldkit.sessions.layout import raw_width

_LOWEST, _HIGHEST = -(2**63), 2**63 - 1


class SampleCheck:
    """Refuses samples that are not as their stream was declared: they could not be read back."""

    def __init__(self, streams: Sequence[StreamInfo]) -> None:
        self._shapes = {info.name: info.shape for info in streams}
        self._row_shapes = {info.name: info.metadata_shape for info in streams}
        self._raw_widths = {info.name: raw_width(info) for info in streams}

    def __call__(self, sample: Sample) -> None:
        """Raise `ValueError` for a sample of another shape or type, or with numbers that no column holds.

        That is the driver's promise.
        """
        numbers = (sample.mono_ns, sample.time_ns, sample.device_time, sample.device_seq)
        if not (min(numbers) >= _LOWEST and max(numbers) <= _HIGHEST):
            raise ValueError(
                f"stream {sample.stream!r}: a time or counter needs more than 64 bits: {numbers}"
            )
        declared = self._shapes.get(sample.stream)
        shape = sample.counts.shape if isinstance(sample, Frame) else (len(sample.values),)
        if shape != declared:
            raise ValueError(f"stream {sample.stream!r} was declared as {declared}, the sample has {shape}")
        if isinstance(sample, Frame):
            self._check_picture(sample)
        elif len(sample.raw) > self._raw_widths[sample.stream]:
            raise ValueError(f"stream {sample.stream!r}: {len(sample.raw)} raw bytes, more than declared")

    def _check_picture(self, frame: Frame) -> None:
        declared, shape = self._row_shapes[frame.stream], frame.metadata_rows.shape
        if shape != declared and (frame.metadata_rows.size or math.prod(declared)):
            raise ValueError(
                f"stream {frame.stream!r} was declared with {declared} metadata rows, the sample has {shape}"
            )
        for counts in (frame.counts, frame.metadata_rows):
            if (counts.dtype.kind, counts.dtype.itemsize) != ("u", 2):
                raise ValueError(f"stream {frame.stream!r}: counts are {counts.dtype}, not uint16")
