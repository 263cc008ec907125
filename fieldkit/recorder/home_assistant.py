"""Messages from which Home Assistant shows a recording: MQTT discovery of its meters, regions and alarms.

A retained document under ``homeassistant/`` describes each sensor and the topic of its state; the states
follow once a minute. Formats and device classes: https://www.home-assistant.io, there
``/integrations/mqtt/#mqtt-discovery``, ``/integrations/sensor.mqtt``, ``/integrations/image.mqtt``,
``/integrations/sensor#device-class``.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple
from urllib.parse import quote

from fieldkit.estimation.estimator import Minute
from fieldkit.model.alarm import Alarm, alarm_of, phase_of
from fieldkit.model.channels import quantity_of
from fieldkit.model.device import StreamInfo
from fieldkit.model.quantities import QUANTITIES, Quantity
from fieldkit.model.samples import Event, Frame, Reading, Severity, is_usable
from fieldkit.model.version import __version__

PREFIX = "homeassistant"
"""Home Assistant's own prefix of discovery, unless it is configured otherwise there."""
UNKNOWN = "None"
"""Payload by which a sensor has no value."""
_ANGLE = {"unit_of_measurement": "°"}
_MEAN = {"state_class": "measurement"}
"""Of all but angles around a circle: the mean of 359° and 1° is no azimuth."""
_ONLINE = "{{ 'online' if value == 'recording' else 'offline' }}"
_IS_ON = "{{ 'OFF' if value_json.phase == 'cleared' else 'ON' }}"


class Publication(NamedTuple):
    """Texts by topic: `configs` describe sensors and are published anew at every connection.

    A state may be a function, called where waiting for it holds up nothing: it draws an image.
    """

    configs: dict[str, str]
    states: dict[str, str | Callable[[], bytes]]


class _Value(NamedTuple):
    words: tuple[str, ...]
    kind: dict[str, str]
    value: float


def alarm_topic(base: str, alarm: Alarm) -> str:
    """The topic of an alarm below `base`."""
    return _topic(base, "alarm", *filter(None, (alarm.condition, alarm.subject)))


@dataclass
class HomeAssistant:
    """Turns what a recording passes on into sensors of Home Assistant below the MQTT topic `base`."""

    base: str
    title: str
    streams: Sequence[StreamInfo]
    least: Severity = Severity.INFO
    draw: Callable[[str], bytes] | None = None
    _latest: dict[str, Reading] = field(default_factory=dict, repr=False)
    _cameras: set[str] = field(default_factory=set, repr=False)

    def update(self, item: object) -> Publication | None:
        """The publication after an item: sensors after a minute, an alarm's after its event."""
        if isinstance(item, Reading):
            self._latest[item.stream] = item
        elif isinstance(item, Frame):
            self._cameras.add(item.stream)
        elif isinstance(item, Minute):
            return self._publication([*self._readings(), *_regions(item)])
        elif isinstance(item, Event) and phase_of(item) and alarm_of(item).severity >= self.least:
            return Publication(self._problem(alarm_of(item)), {})
        return None

    def _publication(self, values: Sequence[_Value]) -> Publication:
        """Values, and the image of every camera that has sent a frame, each with its sensor."""
        configs: dict[str, str] = {}
        states: dict[str, str | Callable[[], bytes]] = {}
        for value in values:
            topic = _topic(self.base, *value.words)
            states[topic] = f"{value.value:.7g}" if math.isfinite(value.value) else UNKNOWN
            configs |= self._config("sensor", value.words, {"state_topic": topic, **value.kind})
        for camera in sorted(self._cameras):
            if self.draw is not None:
                topic = _topic(self.base, "image", camera)
                states[topic] = partial(self.draw, camera)
                keys = {"image_topic": topic, "content_type": "image/png"}
                configs |= self._config("image", ("image", camera), keys)
        return Publication(configs, states)

    def _readings(self) -> Iterator[_Value]:
        """The channels of every meter as read last, kelvin as °C."""
        for info in self.streams:
            if info.is_camera or info.quantity == "position" or info.name not in self._latest:
                continue
            reading = self._latest[info.name]
            quantity = quantity_of(info)
            for name, value in zip(info.channel_names, reading.values, strict=False):
                words = ("stream", info.name, *([name] if len(info.channel_names) > 1 else []))
                yield _value(words, quantity, value if is_usable(reading.quality) else math.nan)

    def _problem(self, alarm: Alarm) -> dict[str, str]:
        topic = alarm_topic(self.base, alarm)
        words = ("alarm", *filter(None, (alarm.condition, alarm.subject)))
        keys = {"state_topic": topic, "json_attributes_topic": topic, "value_template": _IS_ON}
        return self._config("binary_sensor", words, {**keys, "device_class": "problem"})

    def _config(self, component: str, words: Sequence[str], keys: dict[str, Any]) -> dict[str, str]:
        """Topic and text of the document that describes a sensor."""
        node, name = _plain(self.base), _plain("_".join(words))
        document = {
            "name": " ".join(words[1:]), "unique_id": f"fieldkit_{node}_{name}", **keys,
            "availability": [{"topic": f"{self.base}/recorder", "value_template": _ONLINE}],
            "device": {
                "identifiers": [f"fieldkit_{node}"], "name": self.title,
                "sw_version": f"fieldkit {__version__}",
            },
        }  # fmt: skip
        return {f"{PREFIX}/{component}/{node}/{name}/config": json.dumps(document)}


def _value(words: tuple[str, ...], quantity: Quantity, value: float) -> _Value:
    """A value of a stream in the unit that is shown."""
    shown, device_class = quantity.shown, quantity.units.device_class
    kind = {"device_class": device_class} if device_class else {}
    mean = {} if quantity.is_angle else _MEAN
    return _Value(words, {**kind, "unit_of_measurement": shown.shown, **mean}, shown.shown_value(value))


def _regions(minute: Minute) -> Iterator[_Value]:
    for name, kelvin in minute.temperature_k.items():
        yield _value(("region", name, "temperature"), QUANTITIES["temperature"], kelvin)
    for slope in minute.estimates:
        yield _Value(("region", slope.region, "tilt"), {**_ANGLE, **_MEAN}, slope.tilt_deg)
        yield _Value(("region", slope.region, "azimuth"), _ANGLE, slope.azimuth_deg)


def _topic(base: str, *words: str) -> str:
    return "/".join((base, *(quote(word, safe="") for word in words)))


def _plain(text: str) -> str:
    """A text of the letters that discovery allows in its topics."""
    return re.sub(r"[^a-zA-Z0-9_-]", "_", text)
