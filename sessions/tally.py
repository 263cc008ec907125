"""Counting what a recovery keeps of a stream, and naming every run of what it does not."""

from __future__ import annotations

from dataclasses import dataclass, field

from fieldkit.model.samples import Sample
from fieldkit.sessions.records import sample_bytes, sample_crc32


@dataclass(frozen=True, slots=True)
class Lost:
    """A run of lost samples: first and last number, and UTC of the samples around it (0: there is none)."""

    stream: str
    first: int
    last: int
    after_ns: int
    before_ns: int

    @property
    def count(self) -> int:
        """How many samples."""
        return self.last - self.first + 1


@dataclass
class Tally:
    """What became of one stream: samples kept, of those only in the journal, checksums, runs lost."""

    stream: str
    kept: int = 0
    from_journal: int = 0
    lost: list[Lost] = field(default_factory=list)
    crc32s: list[int] = field(default_factory=list)
    last_mono_ns: int = 0
    last_ns: int = 0
    _next: int = 0

    def keep(self, seq: int, mono_ns: int, time_ns: int, crc32: int) -> None:
        """Count a sample; numbers between it and the one before are lost."""
        self._lose(seq, time_ns)
        self.kept += 1
        self.crc32s.append(crc32)
        self.last_mono_ns, self.last_ns, self._next = mono_ns, time_ns, seq + 1

    def keep_sample(self, sample: Sample) -> None:
        """Count a sample that was looked at by itself."""
        crc32 = sample_crc32(sample, *sample_bytes(sample))
        self.keep(sample.seq, sample.mono_ns, sample.time_ns, crc32)

    def finish(self, total: int) -> None:
        """Say how many numbers were given: those after the last kept one are lost."""
        self._lose(total, 0)

    def _lose(self, until: int, before_ns: int) -> None:
        if until > self._next:
            self.lost.append(Lost(self.stream, self._next, until - 1, self.last_ns, before_ns))

    def expects(self, seq: int) -> bool:
        """Whether this number comes after all that were kept."""
        return seq >= self._next
