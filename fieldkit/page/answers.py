"""Answers to requests of browsers: what happened, or what went wrong and what to do next."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from fieldkit.calibrate.horizon import set_skyline
from fieldkit.config import Config, edit
from fieldkit.estimation.region_check import CameraView, check_region
from fieldkit.model.durations import parse_duration, parse_time_of_day
from fieldkit.model.errors import FieldkitError
from fieldkit.model.marks import Mark
from fieldkit.model.samples import Event, Severity
from fieldkit.model.site import Region
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.page import outgoing, requests
from fieldkit.page.conductor import Conductor
from fieldkit.page.hub import Hub
from fieldkit.page.phrases import PageError, issue_document
from fieldkit.page.sessions import PastSessions, identifier
from fieldkit.page.viewer import Viewer
from fieldkit.phrases import ENGLISH, Words, in_language, text_document
from fieldkit.recording import regions as campaign_regions
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.marks import correct_mark, mark_of
from fieldkit.recording.redrawing import change_regions
from fieldkit.recording.requests import Acknowledgement, SentRequest, Shutter, send_to_recorder
from fieldkit.recording.running import (
    is_recorder_present,
    running_session,
    stop_recording,
)
from fieldkit.recording.suggesting import suggestions_in
from fieldkit.results.json_document import attributes
from fieldkit.results.marks import every_mark, replacement, withdrawal
from fieldkit.sessions.reader import open_session
from fieldkit.views import frame_image

log: logging.Logger = logging.getLogger(__name__)
ANSWERS_WITHIN_S = 5.0
"""The recorder looks at its requests once a second."""
QUERIES_AT_ONCE = 2
"""More would take all threads, and a mark or the end of the recording would wait behind everybody's lists."""
Document = dict[str, Any]
T = TypeVar("T")


class Done(NamedTuple):
    """Result of a request, and whether it went well: a text, data, or the recorder's event."""

    text: str = ""
    data: Any = None
    ok: bool = True
    event: Document | None = None

    def answer(self, id: int | None, language: str = ENGLISH) -> Document:
        """The answer in a language to a request; with the values of its text, where it has no other data."""
        answer = {"type": "answer", "id": id, **self._asdict(), **text_document(self.text)}
        data = answer.get("data") if self.data is None else self.data
        return {**answer, "data": data, "text": in_language(self.text, language)}


def failure(id: int | None, error: FieldkitError, language: str) -> Document:
    """The answer that explains an error."""
    return Done(error.words, ok=False).answer(id, language)


@dataclass
class Answers:
    """Carries out what viewers ask for."""

    config: Config
    hub: Hub
    conductor: Conductor
    past: PastSessions
    _queries: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(QUERIES_AT_ONCE))

    async def to(self, viewer: Viewer, request: requests.Request) -> Document:
        """Do what is asked and answer; an error becomes an answer."""
        try:
            if viewer.role != "control" and not isinstance(request, requests.FOR_ANYONE):
                raise PageError("view_only")
            return (await self._carry_out(viewer, request)).answer(request.id, viewer.language)
        except FieldkitError as error:
            return failure(request.id, error, viewer.language)

    async def _carry_out(self, viewer: Viewer, request: requests.Request) -> Done:
        match request:
            case requests.Picture():
                self.hub.set_mode(viewer, request.mode)
                return Done()
            case requests.Value():
                return Done(data={"temperature_c": self._value_c(request)})
            case requests.CheckRegion():
                return Done(data=await self._query(self._verdict, request, viewer.language))
            case requests.Sessions():
                return Done(data=await self._query(self.past.rows, viewer.role))
            case requests.CheckSession():
                ok, count, findings = await self.past.check(request.session)
                issues = [issue_document(finding, viewer.language) for finding in findings]
                return Done(Words("check.ok", count=count) if ok else "", {"issues": issues}, ok)
            case requests.EstimateSession():
                return Done(data=await self.past.estimate(request.session))
            case requests.SessionSlopes():
                return Done(data=await self._query(self.past.slopes, request.session))
            case requests.Marks():
                return Done(data=await self._query(self._marks, request.session))
            case requests.TakeBack() | requests.EditMark():
                return await self._correct_mark(request)
            case requests.Start() | requests.Stop():
                return await asyncio.to_thread(self._start_or_stop, request)
            case requests.AddMark():
                return await self._by_recorder(self._send_mark, request)
            case requests.Shutter():
                return await self._by_recorder(send_to_recorder, self.config.recordings, Shutter())
            case requests.Acknowledge():
                return await self._by_recorder(self._acknowledge, request.alarm)
            case requests.Skyline():
                return await asyncio.to_thread(self._set_skyline, request)
            case requests.SuggestRegions():
                return Done(data=await asyncio.to_thread(self._suggestions, request))
            case _:
                return await self._redraw(request)

    async def _query(self, query: Callable[..., T], *arguments: Any) -> T:
        """Result of a function that runs in a thread and changes nothing."""
        async with self._queries:
            return await asyncio.to_thread(query, *arguments)

    # --- the recording

    def _start_or_stop(self, request: requests.Start | requests.Stop) -> Done:
        if isinstance(request, requests.Stop):
            path = stop_recording(
                self.config.recordings, lambda silent: log.warning(silent.at(self.config.site))
            )
            if path is None:
                return Done(Words("done.called_off"))
            report = f"/session/{identifier(path)}/report"
            about = {"session": path.stem, "report_url": report}
            return Done(Words("done.sealed", session=path.stem), about)
        session = self.conductor.start(record_options(request))
        return Done(Words("done.started", session=session.stem if session else ""))

    def _send_mark(self, request: requests.AddMark) -> SentRequest:
        folder = self.config.recordings
        mark, _ = mark_of(
            folder, lambda: self.config, request.text, kind=request.kind, at=request.at, to=request.to
        )
        return send_to_recorder(folder, mark)

    def _session_to_mark(self, session: str | None) -> Path:
        """The session whose marks are meant: of the list, or the running one."""
        return self.past.sealed_path(session) if session else running_session(self.config.recordings)

    def _marks(self, session: str | None) -> list[Document]:
        with open_session(self._session_to_mark(session)) as opened:
            counting = opened.marks()
            every = every_mark(opened)
        return [outgoing.mark(number, every[number], counts=number in counting) for number in sorted(every)]

    async def _correct_mark(self, request: requests.TakeBack | requests.EditMark) -> Done:
        path = self._session_to_mark(request.session)
        correction = await asyncio.to_thread(_correction, path, request)
        if request.session is None:
            return await self._by_recorder(send_to_recorder, path.parent, correction)
        await asyncio.to_thread(correct_mark, path, lambda session: correction)
        key = "done.taken_back" if correction.takes_back else "done.mark"
        return Done(Words(key, mark=request.mark, text=correction.text))

    def _acknowledge(self, alarm: str) -> SentRequest:
        if alarm not in [present.id for present in self.hub.latest.alarms]:
            raise PageError("no_alarm")
        return send_to_recorder(self.config.recordings, Acknowledgement(alarm))

    async def _by_recorder(self, send: Callable[..., SentRequest], *arguments: Any) -> Done:
        """Send a request to the recorder; the answer is the event that it stores."""
        with self._listening() as events:
            request = await asyncio.to_thread(send, *arguments)
            return await self._await_stored(request, events)

    async def _await_stored(self, request: SentRequest, events: asyncio.Queue[Event]) -> Done:
        try:
            async with asyncio.timeout(ANSWERS_WITHIN_S):
                while (event := await events.get()).data.get("request") != request.id:
                    pass
        except TimeoutError:
            raise PageError("silent", seconds=f"{ANSWERS_WITHIN_S:.0f}") from None
        return Done(ok=event.severity is Severity.INFO, event=outgoing.event(event))

    @contextmanager
    def _listening(self) -> Iterator[asyncio.Queue[Event]]:
        """Events from before a request is sent, so that none is missed; a thread of the hub has them."""
        loop, events = asyncio.get_running_loop(), asyncio.Queue[Event]()

        def listen(event: Event) -> None:
            loop.call_soon_threadsafe(events.put_nowait, event)

        self.hub.listeners.append(listen)
        try:
            yield events
        finally:
            self.hub.listeners.remove(listen)

    # --- the picture

    def _value_c(self, request: requests.Value) -> float:
        latest, frame = self.hub.latest, self.hub.latest.frame
        x, y = round(request.x), round(request.y)
        if frame is None or not (0 <= y < frame.counts.shape[0] and 0 <= x < frame.counts.shape[1]):
            return math.nan
        info = latest.streams[frame.stream]
        pixel = frame._replace(counts=frame.counts[y : y + 1, x : x + 1])
        return float(frame_image.values(pixel, info)[0, 0])

    # --- regions

    def _verdict(self, request: requests.CheckRegion, language: str) -> Document:
        region = request.region.region
        if request.shrink:
            region = region.shrunk(request.shrink)
        view, present = self._drawn_on(request.session)
        replaced = request.instead_of or region.name
        others = [other for other in present if not other.camera and other.name != replaced]
        check = check_region(region, view, others)
        about = {"spread_c": check.spread_k, "points_px": region.points_px}
        about["issues"] = [issue_document(text_document(issue), language) for issue in check.issues]
        return attributes(check, "pixels", "level", "shrink_px") | about

    def _suggestions(self, request: requests.SuggestRegions) -> list[Document]:
        view, present = self._drawn_on(request.session)
        if view is None or view.frame is None:
            raise PageError("no_temperatures")
        return [suggestion.document() for suggestion in suggestions_in(view.frame, present, view.noise_k)]

    def _drawn_on(self, session: str | None) -> tuple[CameraView | None, Sequence[Region]]:
        """The frame that is drawn on, and the regions there already."""
        if session is None:
            return self._latest_view(), self.hub.latest.regions
        frame = self.past.frame_k(session)
        return CameraView(frame.shape, frame), self.config.regions

    def _latest_view(self) -> CameraView | None:
        latest, frame = self.hub.latest, self.hub.latest.frame
        if frame is None:
            return None
        info = latest.streams[frame.stream]
        values = frame_image.values(frame, info)
        is_known = frame_image.unit(info) == "°C" and bool(np.isfinite(values).all())
        view = campaign_regions.camera_views(self.config, [info])[""]
        return replace(view, frame=values + CELSIUS_ZERO_K) if is_known else view

    async def _redraw(self, request: requests.Redrawing) -> Done:
        """Change the campaign's regions, and those of its recording if one runs.

        What they lack together, such as a reference, may come with the next change.
        """
        key, name, change = _change(request)
        with self._listening() as events:
            _, request_sent = await asyncio.to_thread(change_regions, self.config.path, change)
            missing = await asyncio.to_thread(self._reread)
            if request_sent is None:
                return Done(Words(key, name=name, missing=missing))
            return await self._await_stored(request_sent, events)

    def _reread(self) -> list[str]:
        """Use the configuration as it was changed; what its regions still lack."""
        self.config, missing = campaign_regions.read_regions(self.config.path, self.conductor.settings)
        self.conductor.use(self.config)
        return missing

    # --- the horizon

    def _set_skyline(self, request: requests.Skyline) -> Done:
        """Make a skyline the site's horizon; a recording keeps the one it began with."""
        if is_recorder_present(self.config.recordings):
            raise PageError("horizon_kept")
        frame = self.hub.latest.frame
        if frame is None:
            raise PageError("no_frame")
        shape = frame.counts.shape
        horizon = set_skyline(self.config, request.points, (shape[0], shape[1]), frame.time_ns)
        highest = f"{max(elevation for _, elevation in horizon):.1f}"
        return Done(Words("done.skyline", highest=highest, missing=self._reread()))


def _change(request: requests.Redrawing) -> tuple[str, str, Callable[[edit.Draft], Any]]:
    """A change of ``fieldkit.toml``: the key of its text, the region, and the function that makes it."""
    match request:
        case requests.AddRegion(region=drawn):
            return "done.added", drawn.name, lambda draft: edit.add_region(draft, _table(drawn))
        case requests.RemoveRegion(name=name):
            return "done.removed", name, lambda draft: edit.remove_region(draft, name)
        case requests.EditRegion(name=name, region=drawn):
            return "done.changed", drawn.name, lambda draft: edit.change_region(draft, name, _table(drawn))


def _correction(path: Path, request: requests.TakeBack | requests.EditMark) -> Mark:
    with open_session(path) as session:
        if isinstance(request, requests.TakeBack):
            return withdrawal(session, request.mark)
        return replacement(session, request.mark, request.text, label=request.kind, at=request.at)


def record_options(request: requests.Start) -> RecordOptions:
    """The recording that is asked for; raises `ConfigError` for a wrong duration or time of day."""
    return RecordOptions(
        name=request.name,
        duration_s=parse_duration(request.duration) if request.duration else None,
        until=parse_time_of_day(request.until) if request.until else None,
        include_last_s=parse_duration(request.include_last) if request.include_last else None,
        allow_missing=request.allow_missing,
    )


def _table(drawn: requests.DrawnRegion) -> dict[str, Any]:
    """The keys of a drawn region in ``fieldkit.toml``; None removes one."""
    points_px = campaign_regions.written_points(drawn.points_px)
    return {**drawn.model_dump(exclude_unset=True), "points_px": points_px}
