"""The hub: the latest state of a preview or a recording, passed to all viewers.

Items come from a thread that reads instruments or a feed; viewers live in the event loop. Every document and
every picture is encoded once, in the thread, whatever the number of viewers.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from fieldkit.config import Config
from fieldkit.estimation.estimator import Minute
from fieldkit.model.arrays import FloatArray
from fieldkit.model.samples import Event, Frame, is_showable
from fieldkit.model.site import Region
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.model.version import __version__
from fieldkit.page import outgoing
from fieldkit.page.pictures import Mode, picture
from fieldkit.page.viewer import Role, Viewer
from fieldkit.physics.radiance import surface_temperature_k
from fieldkit.recording.preview import missing_instruments
from fieldkit.results.json_document import attributes, plain_json
from fieldkit.sessions.layout import MAX_REGIONS
from fieldkit.views import frame_image
from fieldkit.views.latest import Item, Latest

Phase = Literal["preview", "starting", "waiting", "recording", "sealing", "no-instruments"]
FASTEST_PICTURES_S = 0.03
"""A simulated field may run faster than time; eyes do not."""
MAX_VIEWERS = 8


@dataclass(frozen=True, slots=True)
class State:
    """The page's present state, and whether it is a recording that this page started (`ours`)."""

    phase: Phase = "no-instruments"
    session: str | None = None
    started_ns: int | None = None
    planned_end_ns: int | None = None
    ours: bool = False
    problem: str | None = None


class Hub:
    """Passes what a preview or recording shows to viewers; `show` and `begin` may be called by any thread."""

    def __init__(self, config: Config) -> None:
        self.config: Config = config
        self.state: State = State()
        self._settings = config.estimator_settings()
        self.latest: Latest = Latest(config.site, config.regions, ())
        self.viewers: list[Viewer] = []
        self.listeners: list[Callable[[Event], None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._pictures: dict[Mode, int] = {}
        self._last_picture_s = 0.0
        self._mask = lru_cache(MAX_REGIONS)(Region.mask)

    # --- from the thread that has the items

    def begin(self, latest: Latest) -> None:
        """Show another preview or recording from now on."""
        self.latest = latest
        for document in self._so_far():
            self._post(document)

    def show(self, item: Item) -> None:
        """Take an item; what browsers need of it is sent to all of them."""
        regions, alarms = self.latest.regions, self.latest.alarms
        self.latest.update(item)
        if self.latest.regions != regions:
            self._post(outgoing.regions(self.latest.regions))
        if self.latest.alarms != alarms:
            self._post(outgoing.alarms(self.latest.alarms))
        if isinstance(item, Frame):
            self._show_frame(item)
        elif isinstance(item, Minute):
            self._post(outgoing.minute(item))
        elif isinstance(item, Event):
            self._post(outgoing.event(item))
            for listener in tuple(self.listeners):
                listener(item)

    def close(self) -> None:
        """The preview is over; the hub goes on."""

    def use(self, config: Config) -> None:
        """Compute temperatures with other settings."""
        self.config, self._settings = config, config.estimator_settings()

    def redraw(self, config: Config) -> None:
        """Show other regions; those of a recording come from its recorder."""
        self.use(config)
        self.latest.regions = tuple(config.regions)
        self._post(outgoing.regions(self.latest.regions))

    def become(self, **changes: Any) -> None:
        """Change the state that all viewers see."""
        state = replace(self.state, **changes)
        if state != self.state:
            self.state = state
            self._post(self._state())

    def _show_frame(self, frame: Frame) -> None:
        now = time.monotonic()
        is_shown = frame is self.latest.frame and is_showable(frame.quality)  # of the first camera
        if not is_shown or now - self._last_picture_s < FASTEST_PICTURES_S:
            return
        self._last_picture_s = now
        for mode in {viewer.mode for viewer in tuple(self.viewers)} - {"off"}:
            self._in_loop(self._offer, mode, self._picture(frame, mode))

    def _picture(self, frame: Frame, mode: Mode) -> bytes:
        self._pictures[mode] = seq = self._pictures.get(mode, 0) + 1
        return picture(frame, self.latest.streams[frame.stream], mode, seq)

    def _post(self, document: dict[str, Any]) -> None:
        if self.viewers:
            self._in_loop(self._send_all, plain_json(document))

    def _in_loop(self, act: Callable[..., None], *arguments: Any) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(act, *arguments)

    # --- in the event loop

    async def run(self) -> None:
        """Send the present numbers once a second, until cancelled."""
        self._loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(1.0)
            self._end_sessions()
            if self.viewers:
                self._send_all(plain_json(self._now()))

    def join(self, viewer: Viewer) -> bool:
        """Add a viewer and queue what is known for it; False if the page has as many as it can serve.

        A viewer who may control takes the place of the oldest that may not.
        """
        if len(self.viewers) >= MAX_VIEWERS:
            others = [other for other in self.viewers if other.role == "view"]
            if viewer.role == "view" or not others:
                return False
            self.leave(others[0], "displaced")
        self.viewers.append(viewer)
        for document in (self._hello(viewer.role), self._state(), *self._so_far()):
            viewer.text(plain_json(document))
        return True

    def leave(self, viewer: Viewer, reason: str = "") -> None:
        """Remove a viewer."""
        if viewer in self.viewers:
            self.viewers.remove(viewer)
        viewer.leave(reason or "left")

    def set_mode(self, viewer: Viewer, mode: Mode) -> None:
        """Send a viewer pictures of this kind, the last one at once."""
        viewer.mode = mode
        frame = self.latest.frame
        if mode != "off" and frame is not None:
            viewer.picture(self._picture(frame, mode))

    def _end_sessions(self) -> None:
        for viewer in [viewer for viewer in self.viewers if time.time() > viewer.ends_at]:
            self.leave(viewer, "ended")

    def _send_all(self, text: str) -> None:
        for viewer in self.viewers:
            viewer.text(text)

    def _offer(self, mode: Mode, message: bytes) -> None:
        for viewer in self.viewers:
            if viewer.mode == mode:
                viewer.picture(message)

    # --- documents

    def _hello(self, role: Role) -> dict[str, Any]:
        config, site = self.config, self.config.site
        name = config.tables.campaign.title or config.directory.name
        about = {"type": "hello", "role": role, "version": __version__, "campaign": name}
        return {**about, "site": {"zone": site.timezone}, "simulated": config.tables.simulation is not None}

    def _state(self) -> dict[str, Any]:
        state = self.state
        times = {
            name.replace("_ns", "_ms"): None if time_ns is None else outgoing.ms(time_ns)
            for name, time_ns in attributes(state, "started_ns", "planned_end_ns").items()
        }
        problem = state.problem and outgoing.in_all_languages(state.problem)
        return {"type": "state", **attributes(state, "phase", "session", "ours"), "problem": problem, **times}

    def _so_far(self) -> list[dict[str, Any]]:
        latest = self.latest
        streams = tuple(latest.streams.values())
        messages = [
            outgoing.streams(streams, missing_instruments(self.config, streams)),
            outgoing.regions(latest.regions),
        ]
        if latest.minute is not None:
            messages.append(outgoing.minute(latest.minute))
        messages += [outgoing.alarms(latest.alarms), *map(outgoing.event, latest.events)]
        return [*messages, outgoing.history(latest.trend), self._now()]

    def _now(self) -> dict[str, Any]:
        return outgoing.now(self.latest, self.region_temperatures_c(), self._bytes_per_s())

    def _bytes_per_s(self) -> float:
        """Mean rate of the recording's growth; NaN before there is one."""
        latest = self.latest
        seconds = (latest.time_ns - latest.start_ns) / 1e9
        return latest.health.written_bytes / seconds if latest.health and seconds > 0 else math.nan

    def region_temperatures_c(self) -> dict[str, float]:
        """Mean surface temperature of each region in its camera's last frame, °C, where there is one."""
        frames = {region.camera: self.latest.frame_of(region.camera) for region in self.latest.regions}
        temperatures_c = {
            camera: frame_image.values(frame, info)
            for camera, frame in frames.items()
            if frame is not None and frame_image.unit(info := self.latest.streams[frame.stream]) == "°C"
        }
        return {
            region.name: self._mean_c(region, temperatures_c[region.camera])
            for region in self.latest.regions
            if region.camera in temperatures_c
        }

    def _mean_c(self, region: Region, shown: FloatArray) -> float:
        inside = shown[self._mask(region, (shown.shape[0], shown.shape[1]))]
        settings, own = self._settings, region.emissivity
        emissivity = settings.surface.emissivity if math.isnan(own) else own
        if not len(inside):
            return math.nan
        brightness_k = float(inside.mean()) + CELSIUS_ZERO_K
        kelvin = surface_temperature_k(np.array(brightness_k), emissivity, settings.reflected_temperature_k)
        return float(kelvin) - CELSIUS_ZERO_K
