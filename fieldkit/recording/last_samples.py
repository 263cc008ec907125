"""The last minutes of a preview, handed to the recording that ends it (``record --include-last``).

The recorder makes the folder ``recordings/.last-samples`` before it takes its lock. A preview that gives way
to it finds the folder, leaves there what it still has, in the form of a journal, and closes the instruments.
The monotonic counter is one for all processes of a computer: samples keep their `mono_ns`, and their UTC is
that of the anchor of the session which they enter, as of every sample in it.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import math
import shutil
import uuid
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fieldkit.config import Config
from fieldkit.model.clock import Clock
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import FieldkitError, SessionError
from fieldkit.model.samples import UNNUMBERED, Frame, Reading, Sample
from fieldkit.model.units import SECOND_NS
from fieldkit.recorder.device_reader import DeviceReader
from fieldkit.recorder.recorder import Shown
from fieldkit.recording.opening import Instruments
from fieldkit.recording.preflight import Notify
from fieldkit.recording.running import LOCK_NAME
from fieldkit.sessions.journal import Journal, SessionIdentity
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.layout import SessionHeader
from fieldkit.sessions.lock import is_locked
from fieldkit.sessions.records import SampleRow

log: logging.Logger = logging.getLogger(__name__)

FOLDER = ".last-samples"
KEPT_S = 300.0
KEPT_BYTES = 128_000_000
"""As much of a preview stays in memory as fits both."""


class SampleRing:
    """A view that keeps the last samples in memory."""

    def __init__(self) -> None:
        self._kept: deque[Sample] = deque()
        self._bytes = 0

    def show(self, item: Shown) -> None:
        """Keep a sample; anything else belongs to the preview alone."""
        if isinstance(item, Frame | Reading):
            self._kept.append(item)
            self._bytes += _size(item)
            oldest_ns = item.mono_ns - round(KEPT_S * SECOND_NS)
            while self._bytes > KEPT_BYTES or self._kept[0].mono_ns < oldest_ns:
                self._bytes -= _size(self._kept.popleft())

    def since(self, mono_ns: int) -> list[Sample]:
        """The samples from a time on (monotonic), as far as they are kept."""
        return [sample for sample in self._kept if sample.mono_ns >= mono_ns]

    def close(self) -> None:
        """Nothing to close."""


class LastSamples(SampleRing):
    """The last samples of a preview, which it leaves to a recorder that asks for them."""

    def __init__(self, config: Config, instruments: Instruments) -> None:
        super().__init__()
        self._folder = config.recordings / FOLDER
        self._header = SessionHeader(title="", site=config.site, streams=instruments.streams)
        self._clock = instruments.clock

    def close(self) -> None:
        """Leave what is kept to the recorder, if one asked for it; it records without, where that fails."""
        if not self._folder.is_dir():
            return
        try:
            self._hand_over()
        except (OSError, FieldkitError) as error:
            log.warning("the recording begins without the last samples of the preview: %s", error)

    def _hand_over(self) -> None:
        start_ns, anchor_ns = self._clock.to_utc_ns(self._clock.mono_ns()), self._clock.to_utc_ns(0)
        identity = SessionIdentity(str(uuid.uuid4()), start_ns, anchor_ns, self._header)
        with contextlib.closing(Journal(self._folder, identity)) as journal:
            numbers: defaultdict[str, Iterator[int]] = defaultdict(itertools.count)
            for sample in self._kept:
                journal.append(sample._replace(seq=next(numbers[sample.stream])))  # as its checksum has it


def _size(sample: Sample) -> int:
    return sample.counts.nbytes if isinstance(sample, Frame) else 100


def ask_for_last_samples(recordings: Path) -> None:
    """Have the preview of a campaign leave its last samples; call before `only_recorder`, which ends it.

    Where the folder cannot be written nothing is done: the recorder finds that out with better words.
    """
    if is_locked(recordings, LOCK_NAME):
        return
    shutil.rmtree(recordings / FOLDER, ignore_errors=True)  # of a recorder that was killed
    with contextlib.suppress(OSError):
        (recordings / FOLDER).mkdir(parents=True)


@contextmanager
def left_samples(recordings: Path) -> Iterator[LeftSamples | None]:
    """Samples left by a preview for this recorder, deleted at the end; None where there is nothing."""
    with contextlib.ExitStack() as opened:
        opened.callback(shutil.rmtree, recordings / FOLDER, ignore_errors=True)
        try:
            left = LeftSamples(opened.enter_context(JournalReader(recordings / FOLDER)))
        except (SessionError, OSError):  # it is empty, not there, or cannot be read
            left = None
        yield left


def reach_s(streams: Sequence[StreamInfo]) -> float:
    """Time that memory holds of the samples of all these streams, seconds."""
    bytes_per_s = sum(info.rate_hz * 2 * math.prod(info.shape) for info in streams if info.is_camera)
    return min(KEPT_S, KEPT_BYTES / max(1.0, bytes_per_s))


@dataclass(frozen=True, slots=True)
class Included:
    """Samples from before a recording that become its first ones, in order; `start_ns` is monotonic.

    `readers` read already, and go on for the recording.
    """

    start_ns: int
    samples: Iterable[Sample]
    readers: Sequence[DeviceReader] = ()


@dataclass(frozen=True, slots=True)
class LeftSamples:
    """The journal of a preview that has ended."""

    journal: JournalReader

    @property
    def end_ns(self) -> int:
        """When the preview ended, on its monotonic clock."""
        identity = self.journal.identity
        return identity.start_ns - identity.anchor_ns

    def include(self, instruments: Instruments, seconds: float, notify: Notify) -> Included | None:
        """Those of the last `seconds` that fit the streams of the opened instruments; None without any.

        `notify` receives the streams that are declared otherwise now.
        """
        samples = self._samples(self._streams(instruments, notify), instruments.clock, seconds)
        first = next(samples, None)
        return None if first is None else Included(first.mono_ns, itertools.chain([first], samples))

    def _streams(self, instruments: Instruments, notify: Notify) -> dict[int, StreamInfo]:
        """The preview's streams by number, as far as they are declared now as they were then."""
        opened, alike = {info.name: info for info in instruments.streams}, dict[int, StreamInfo]()
        for number, info in enumerate(self.journal.identity.header.streams):
            now = opened.get(info.name)
            if now and now.has_the_columns_of(info) and now.is_read_as(info):
                alike[number] = info
            else:
                notify(
                    f"{info.name}: its last samples are not included: it is not declared as in the preview"
                )
        return alike

    def _samples(self, streams: dict[int, StreamInfo], clock: Clock, seconds: float) -> Iterator[Sample]:
        now_ns = clock.mono_ns()
        for row in self._rows():
            sample = row.sample(streams[row.stream]) if row.stream in streams else None
            if sample is not None and now_ns - round(seconds * SECOND_NS) <= sample.mono_ns <= now_ns:
                yield sample._replace(time_ns=clock.to_utc_ns(sample.mono_ns), seq=UNNUMBERED)

    def _rows(self) -> Iterator[SampleRow]:
        """Those that can be read: what is left of a preview must not end the recording."""
        try:
            for row in self.journal.since(0, sum(self.journal.written)):
                if isinstance(row, SampleRow):
                    yield row
        except (OSError, ValueError, FieldkitError) as error:
            log.warning("the rest of the preview's last samples cannot be read: %s", error)
