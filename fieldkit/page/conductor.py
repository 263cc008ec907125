"""The conductor: shows the recording that runs, whoever started it, and otherwise a preview.

A recording is an ordinary ``fieldkit record`` in a process and session of its own: it goes on when the page
ends, however it ends. The conductor reads the recorder's feed and never touches the instruments meanwhile.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from fieldkit.config import Config
from fieldkit.model.errors import (
    ConfigError,
    DeviceError,
    FieldkitError,
    RefusedError,
    StorageError,
)
from fieldkit.model.samples import Event, EventKind
from fieldkit.page.hub import Hub
from fieldkit.page.phrases import PageError
from fieldkit.phrases import Words
from fieldkit.recording.background import BackgroundRecording, RecordOptions
from fieldkit.recording.last_samples import LastSamples
from fieldkit.recording.opening import open_instruments
from fieldkit.recording.preview import LivePreview
from fieldkit.recording.regions import read_regions
from fieldkit.recording.running import (
    LOOK_EVERY_S,
    is_recorder_present,
    previewing,
    session_in_progress,
    waiting_recorder,
)
from fieldkit.recording.status_request import feed_path
from fieldkit.sessions.lock import is_locked, journal_path, owner
from fieldkit.views.feed import FeedReader, FeedStart
from fieldkit.views.latest import Item, Latest, Trend

log: logging.Logger = logging.getLogger(__name__)

FEED_WITHIN_S = 5.0
"""A recorder opens its feed at once."""
TRY_AGAIN_S = 3.0


class Conductor:
    """Watches a campaign and feeds the hub; `run` is a thread, all other methods may be called from any."""

    def __init__(
        self, config: Config, hub: Hub, settings: Sequence[str] = (), *, preview: bool = True
    ) -> None:
        self.config: Config = config
        self.hub = hub
        self.settings: tuple[str, ...] = tuple(settings)
        self._previews = preview
        self._ending = threading.Event()
        self._starting = threading.Lock()
        self._child: BackgroundRecording | None = None
        self._preview: LivePreview | None = None
        self._reader: FeedReader | None = None

    def run(self) -> None:
        """Follow recordings and preview in between until `close`."""
        while not self._ending.wait(LOOK_EVERY_S):
            try:
                self._next()
            except Exception:  # the page must outlive whatever instruments and files do
                log.exception("the page lost what it showed")
                self.hub.become(phase="no-instruments", session=None, problem=Words("problem.failed"))
                self._ending.wait(TRY_AGAIN_S)

    def close(self) -> None:
        """End `run`; a recording goes on."""
        self._ending.set()
        if self._reader is not None:
            self._reader.close()
        self._forget_child()

    def _forget_child(self) -> None:
        if self._child is not None:
            self._child.forget()

    def use(self, config: Config) -> None:
        """Preview with other regions from now on, and record with them next time."""
        self.config = config
        if self._preview is not None:
            self._preview.measure(config)
        if self.hub.state.session is None:
            self.hub.redraw(config)
        else:
            self.hub.use(config)

    def _next(self) -> None:
        session = session_in_progress(self.config.recordings)
        if session is not None:
            self._follow(session)
        elif waiting_recorder(self.config.recordings) is not None:
            self.hub.become(phase="waiting", session=None, problem=None)
        elif is_recorder_present(self.config.recordings) or self._is_starting():
            self.hub.become(phase="starting", session=None, problem=None)
        elif self._previews:
            self._show_preview()
        else:
            self.hub.become(phase="no-instruments", session=None, ours=False)

    # --- a recording

    def start(self, options: RecordOptions) -> Path | None:
        """Start ``fieldkit record`` with the page's settings; its session, None if it waits for a trigger.

        Raises `RefusedError` if something is recorded already, or with what the recorder said.
        """
        options = options.model_copy(update={"settings": self.settings})
        with self._starting:
            if self._is_starting() or is_recorder_present(self.config.recordings):
                raise PageError("recording")
            self._forget_child()
            child = BackgroundRecording(self.config.directory, options)
            self._child = child
        return child.await_start(self.config)

    def exit_code(self, ending: threading.Event) -> int | None:
        """Exit code of the recording that `start` started last, once it has ended (negative: by a signal).

        None if there was none, or if `ending` is set before.
        """
        while self._is_starting():
            if ending.wait(LOOK_EVERY_S):
                return None
        return None if self._child is None else self._child.exit_code

    def _is_starting(self) -> bool:
        return self._child is not None and self._child.exit_code is None

    def _follow(self, session: Path) -> None:
        """Show a recording until its process lets go of it."""
        ours = self._child is not None and owner(journal_path(session)) == self._child.pid
        self.hub.become(phase="recording", session=session.stem, ours=ours, problem=None)
        reader = self._connect(session)
        if reader is None:
            self.hub.become(problem=Words("problem.no_feed"))
        else:
            self._show_recording(reader)
        while session_in_progress(self.config.recordings) == session and not self._ending.wait(LOOK_EVERY_S):
            pass
        self.hub.become(session=None, started_ns=None, planned_end_ns=None, ours=False, problem=None)

    def _connect(self, session: Path) -> FeedReader | None:
        deadline = time.monotonic() + FEED_WITHIN_S
        while not self._ending.is_set() and is_locked(journal_path(session)):
            with suppress(OSError):
                return FeedReader(feed_path(session))
            if time.monotonic() > deadline:
                return None
            time.sleep(LOOK_EVERY_S)
        return None

    def _show_recording(self, reader: FeedReader) -> None:
        self._reader = reader
        latest, has_begun = self.hub.latest, False
        for item in reader.items():
            if isinstance(item, FeedStart):
                latest = item.latest()
                self.hub.become(planned_end_ns=item.planned_end_ns, started_ns=item.start_ns or None)
            elif isinstance(item, Trend):
                latest.trend = item
                self.hub.begin(latest)
                has_begun = True
            elif has_begun:
                self._show(item)
        self._reader = None

    def _show(self, item: Item) -> None:
        self.hub.show(item)
        if self.hub.state.started_ns is None:
            self.hub.become(started_ns=self.hub.latest.start_ns)
        if isinstance(item, Event) and item.kind is EventKind.STOP:
            self.hub.become(phase="sealing")

    # --- the preview

    def _show_preview(self) -> None:
        """Show the instruments until a recorder wants them; what is missing is a problem, not an end."""
        try:
            # a reference that was removed is drawn anew on the picture
            self.config, problems = read_regions(self.config.path, self.settings)
            with (
                previewing(self.config.recordings) as recorder_waits,
                open_instruments(self.config, allow_missing=True) as instruments,
            ):
                self.hub.begin(Latest(self.config.site, self.config.regions, instruments.streams))
                phase = "preview" if instruments.devices else "no-instruments"
                problem = Words("text.all", texts=problems) if problems else None
                self.hub.become(phase=phase, session=None, problem=problem)
                self._preview = LivePreview(
                    self.config, instruments, [self.hub, LastSamples(self.config, instruments)]
                )
                self._preview.run(None, lambda: self._ending.is_set() or recorder_waits())
        except (ConfigError, DeviceError, RefusedError, StorageError, OSError) as error:
            words = error.words if isinstance(error, FieldkitError) else StorageError(str(error)).words
            self.hub.become(phase="no-instruments", session=None, problem=words)
            self._ending.wait(TRY_AGAIN_S)
        finally:
            self._preview = None
