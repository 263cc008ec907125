"""A recording as streams of the Lab Streaming Layer: meters, regions and events, for LabRecorder and others.

Names, units and channels stand in the description of each stream (https://github.com/sccn/xdf/wiki/Meta-Data).
Stamps are those of the samples, on the clock of LSL. An outlet keeps six minutes for a reader that is
slow and then drops the oldest: nothing waits for it.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fieldkit.estimation.estimator import Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, Reading, is_usable
from fieldkit.model.slope import SLOPE_FIELDS
from fieldkit.views.latest import Item

if TYPE_CHECKING:
    from pylsl import StreamOutlet

Channels = Sequence[tuple[str, str]]
"""Label and unit of each channel."""
_OF_REGION: Channels = (("temperature", "K"), *((field.key, field.unit) for field in SLOPE_FIELDS.values()))
_NO_SLOPE = (math.nan,) * len(SLOPE_FIELDS)


class LslOutlets:
    """A view that offers each meter but positions, each region once a minute, and events as text.

    `source` tells its streams from those of another campaign; `utc_ns` is now. Raises `ConfigError` if pylsl
    or the library that it loads is missing.
    """

    def __init__(
        self, source: str, streams: Sequence[StreamInfo], regions: Sequence[str], utc_ns: int
    ) -> None:
        try:
            import pylsl
        except (ImportError, RuntimeError) as error:  # pylsl without liblsl raises the latter
            raise ConfigError(
                "record.lsl needs pylsl, and liblsl, which its packages for ARM lack",
                fix="pip install 'fieldkit[lsl]', conda install -c conda-forge liblsl, or record.lsl = false",
            ) from error
        self._source, self._begin_ns, self._begin_s = source, utc_ns, float(pylsl.local_clock())
        self._meters = {
            stream.name: stream
            for stream in streams
            if not stream.is_camera and stream.quantity != "position"
        }
        self._outlets: dict[str, StreamOutlet] = {}
        self._outlet("events", "Markers", (("event", ""),))
        for info in self._meters.values():
            self._outlet(info.name, info.quantity, [(label, info.unit) for label in info.channel_names])
        for name in regions:
            self._outlet(f"region {name}", "slope", _OF_REGION)

    def show(self, item: Item) -> None:
        """Send a reading, an event or a minute's regions."""
        if isinstance(item, Reading) and item.stream in self._meters:
            values = item.values if is_usable(item.quality) else (math.nan,) * len(item.values)
            self._outlets[item.stream].push_sample(values, self._stamp_s(item.time_ns))
        elif isinstance(item, Event):
            self._outlets["events"].push_sample([item.text], self._stamp_s(item.time_ns))
        elif isinstance(item, Minute):
            slopes = {
                estimate.region: [getattr(estimate, key) for key in SLOPE_FIELDS]
                for estimate in item.estimates
            }
            for name, kelvin in item.temperature_k.items():
                values = (kelvin, *slopes.get(name, _NO_SLOPE))
                outlet = self._outlet(f"region {name}", "slope", _OF_REGION)
                outlet.push_sample(values, self._stamp_s(item.time_ns))

    def close(self) -> None:
        """The streams end."""
        self._outlets.clear()

    def _stamp_s(self, time_ns: int) -> float:
        return self._begin_s + (time_ns - self._begin_ns) / 1e9

    def _outlet(self, name: str, kind: str, channels: Channels) -> StreamOutlet:
        """The outlet of that name, which may be of a region drawn since."""
        if name not in self._outlets:
            from pylsl import StreamInfo as LslInfo
            from pylsl import StreamOutlet, cf_double64, cf_string

            form = cf_string if kind == "Markers" else cf_double64
            identity = f"fieldkit {socket.gethostname()} {self._source} {name}"
            info = LslInfo(name, kind, len(channels), channel_format=form, source_id=identity)
            described = info.desc().append_child("channels")
            for label, unit in channels:
                channel = described.append_child("channel")
                channel.append_child_value("label", label).append_child_value("unit", unit)
            self._outlets[name] = StreamOutlet(info)
        return self._outlets[name]
