"""What the page does for a request, and the answer: what happened, or what went wrong and what to do next."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fieldkit.config import Config, load_config
from fieldkit.model.durations import parse_duration
from fieldkit.model.errors import ConfigError, FieldkitError, RefusedError
from fieldkit.model.samples import Event, EventKind
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.page import requests
from fieldkit.page.conductor import Conductor
from fieldkit.page.hub import Hub
from fieldkit.page.keys import Keys
from fieldkit.page.sessions import PastSessions
from fieldkit.page.viewer import Viewer
from fieldkit.views import frame_image
from fieldkit.workflows import regions as campaign_regions
from fieldkit.workflows.running import add_mark, mark_of, stop_recording

ANSWERS_WITHIN_S = 5.0
"""The recorder looks at its requests once a second."""
Document = dict[str, Any]


def answer(
    id: int | None, text: str, *, ok: bool = True, fix: str | None = None, data: Any = None
) -> Document:
    """The answer to a request."""
    return {"type": "answer", "id": id, "ok": ok, "text": text, "fix": fix, "data": data}


def failure(id: int | None, error: FieldkitError) -> Document:
    """The answer that explains an error."""
    return answer(id, error.message, ok=False, fix=error.fix)


@dataclass
class Answers:
    """Carries out what viewers ask for."""

    config: Config
    hub: Hub
    conductor: Conductor
    past: PastSessions
    keys: Keys

    async def to(self, viewer: Viewer, request: requests.Request) -> Document:
        """Do what is asked and answer; an error becomes an answer."""
        try:
            if viewer.role != "control" and not isinstance(request, requests.FOR_ANYONE):
                raise RefusedError("this link may only look", fix="open the page by a control link")
            return await self._done(viewer, request)
        except FieldkitError as error:
            return failure(request.id, error)

    async def _done(self, viewer: Viewer, request: requests.Request) -> Document:
        match request:
            case requests.Picture():
                self.hub.set_mode(viewer, request.mode)
                return answer(request.id, "")
            case requests.Value():
                return answer(request.id, "", data={"temperature_c": self._value_c(request)})
            case requests.CheckRegion():
                return answer(request.id, "", data=self._verdict(request))
            case requests.Sessions():
                listed = await asyncio.to_thread(self.past.listed, viewer.role)
                return answer(request.id, "", data=listed)
            case requests.CheckSession():
                ok, text = await self.past.check(request.session)
                return answer(request.id, text, ok=ok)
            case requests.Start() | requests.Stop():
                return await asyncio.to_thread(self._start_or_stop, request)
            case requests.AddMark():
                return await self._marked(request)
            case requests.Link():
                key = await asyncio.to_thread(self.keys.new_link, request.role)
                return answer(request.id, f"a link that works once, to {request.role}", data={"key": key})
            case _:
                return await asyncio.to_thread(self._redraw, request)

    # --- the recording

    def _start_or_stop(self, request: requests.Start | requests.Stop) -> Document:
        if isinstance(request, requests.Stop):
            path = stop_recording(self.config)
            return answer(request.id, f"sealed {path.stem}", data={"session": path.stem})
        session = self.conductor.start(request.name, _end(request), allow_missing=request.allow_missing)
        return answer(request.id, f"recording {session.stem}", data={"session": session.stem})

    async def _marked(self, request: requests.AddMark) -> Document:
        """Drop the mark and wait until the recorder has stored it."""
        mark = mark_of(self.config, request.text, kind=request.kind, at=request.at, to=request.to)

        def is_it(event: Event) -> bool:
            return event.kind is EventKind.MARK and event.text == request.text

        stored = await self._event_after(lambda: add_mark(self.config, mark), is_it)
        return answer(request.id, f"marked: {stored.text}")

    async def _event_after(self, act: Callable[[], Any], is_it: Callable[[Event], bool]) -> Event:
        """The recorder's event that answers; raises `RefusedError` if none comes."""
        loop, found = asyncio.get_running_loop(), asyncio.Event()
        seen: list[Event] = []

        def listen(event: Event) -> None:
            if is_it(event):
                seen.append(event)
                loop.call_soon_threadsafe(found.set)

        self.hub.listeners.append(listen)
        try:
            await asyncio.to_thread(act)
            await asyncio.wait_for(found.wait(), ANSWERS_WITHIN_S)
        except TimeoutError:
            raise RefusedError(
                f"the recorder has not answered within {ANSWERS_WITHIN_S:.0f} s", fix="look at the events"
            ) from None
        finally:
            self.hub.listeners.remove(listen)
        return seen[0]

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

    def _verdict(self, request: requests.CheckRegion) -> Document:
        region = _region(request.region)
        if request.shrink:
            region = _shrunk(region, request.shrink)
        others = [one for one in self.hub.latest.regions if one.name != region.name]
        found = campaign_regions.check_regions([*others, region], *self._frame_k())[-1]
        return {
            "pixels": found.pixels, "spread_c": found.spread_k, "level": found.level,
            "text": "; ".join(found.failures + found.warnings) or "ok", "shrink_px": None,
            "vertices": [list(corner) for corner in region.vertices],
        }  # fmt: skip

    def _frame_k(self) -> tuple[tuple[int, ...] | None, np.ndarray[Any, np.dtype[np.float64]] | None]:
        latest, frame = self.hub.latest, self.hub.latest.frame
        if frame is None:
            return None, None
        info = latest.streams[frame.stream]
        shown = frame_image.values(frame, info)
        is_known = frame_image.unit(info) == "°C" and bool(np.isfinite(shown).all())
        return shown.shape, shown + CELSIUS_ZERO_K if is_known else None

    def _redraw(self, request: requests.Request) -> Document:
        file = self.config.path
        match request:
            case requests.AddRegion():
                campaign_regions.add_region(file, **_table(request.region))
                text = f"added {request.region.name}"
            case requests.RemoveRegion():
                campaign_regions.remove_region(file, request.name)
                text = f"removed {request.name}"
            case _:
                raise ConfigError("this page cannot do that yet", fix="use the command line")
        self.config = load_config(file, settings=self.conductor.settings)
        self.conductor.measure(self.config)
        return answer(request.id, text)


def _end(request: requests.Start) -> list[str]:
    if request.duration:
        return [f"--for={parse_duration(request.duration):g}s"]
    return [f"--until={request.until}"] if request.until else []


def _region(drawn: requests.DrawnRegion) -> Region:
    angles = (drawn.tilt_deg, drawn.azimuth_deg, drawn.emissivity)
    known = (math.nan if value is None else value for value in angles)
    return Region(drawn.name, RegionKind[drawn.role.upper()], tuple(drawn.vertices), *known)


def _shrunk(region: Region, pixels: float) -> Region:
    try:
        return region.shrunk(pixels)
    except ValueError as error:
        raise ConfigError(str(error), fix="shrink it less") from error


def _table(drawn: requests.DrawnRegion) -> dict[str, Any]:
    known = {key: getattr(drawn, key) for key in ("tilt_deg", "azimuth_deg", "emissivity")}
    properties = {key: value for key, value in known.items() if value is not None}
    return {
        "name": drawn.name, "points": drawn.vertices, "reference": drawn.role == "reference", **properties
    }  # fmt: skip
