"""What the page sends to browsers: JSON documents of a recording's latest state.

Times are UTC milliseconds (`time_ms`), temperatures °C, unknown numbers null.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from fieldkit.estimation.estimator import Minute
from fieldkit.model.alarm import Alarm
from fieldkit.model.channels import quantity_of
from fieldkit.model.device import StreamInfo
from fieldkit.model.next_step import Argument, Sentence, Step, Text
from fieldkit.model.samples import Event, Health
from fieldkit.model.site import Region
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.page.requests import DrawnRegion
from fieldkit.views import formatting
from fieldkit.views.latest import Latest, Trend

Document = dict[str, Any]


def in_words(text: Text) -> str:
    """A text with its actions and arguments in plain words: a browser has neither commands nor calls."""
    match text:
        case Sentence(parts):
            return "".join(map(in_words, parts))
        case Step(action, values):
            return " ".join([action.name.lower().replace("_", " "), *map(str, values)])
        case Argument(name, value):
            return name.replace("_", " ") if value is None else f"{name.replace('_', ' ')} {value}"
    return str(text)


def streams(infos: Sequence[StreamInfo], frames_every_s: float | None = None) -> Document:
    """The instruments; `frames_every_s` where a recording keeps bursts of frames only."""
    return {"type": "streams", "streams": [_stream(info, frames_every_s) for info in infos]}


def _stream(info: StreamInfo, frames_every_s: float | None) -> Document:
    rows, cols = info.shape if info.is_camera else (0, 0)
    channels = [] if info.is_camera else list(info.channel_names)
    return {
        "name": info.name, "quantity": info.quantity, "unit": info.unit, "channels": channels,
        "is_camera": info.is_camera, "rows": rows, "cols": cols,
        "every_s": frames_every_s if info.is_camera else None,
    }  # fmt: skip


def regions(regions: Sequence[Region]) -> Document:
    """The regions with their corners in pixels."""
    outlines = [DrawnRegion.of(region).model_dump(by_alias=True) for region in regions]
    return {"type": "regions", "regions": outlines}


def minute(closed: Minute) -> Document:
    """A minute bin: irradiance, sun, contact temperatures, and each region's temperature and slope."""
    slopes = {estimate.region: estimate for estimate in closed.estimates}
    names = {**closed.temperature_k, **slopes}
    return {
        "type": "minute",
        "time_ms": ms(closed.time_ns),
        "irradiance": {"dni_w_m2": closed.dni_w_m2, "model": closed.irradiance_model},
        "sun": {"zenith_deg": closed.sun_zenith_deg, "azimuth_deg": closed.sun_azimuth_deg},
        "contact_c": [celsius(kelvin) for kelvin in closed.contact_k],
        "regions": {name: _measurements(closed, name, slopes.get(name)) for name in names},
    }


def _measurements(closed: Minute, name: str, slope: SlopeEstimate | None) -> Document:
    temperature = {"temperature_c": celsius(closed.temperature_k.get(name, math.nan))}
    if slope is None:
        return {**temperature, "state": "reference", "words": "", "reason": ""}
    angles = {key: getattr(slope, key) for key in SLOPE_FIELDS}
    return {
        **temperature,
        "state": slope.state.name.lower(),
        "words": formatting.state(slope),
        "reason": slope.reason,
        "tilt": formatting.tilt(slope),
        "azimuth": formatting.azimuth(slope),
        **angles,
    }


def history(trend: Trend) -> Document:
    """Temperature and tilt of every region in every minute so far."""
    names = trend.temperature_k.keys() | trend.tilt_deg.keys()
    unknown = [math.nan] * len(trend.times_ns)
    return {
        "type": "history",
        "minutes": [ms(time_ns) for time_ns in trend.times_ns],
        "regions": {
            name: {
                "temperature_c": [celsius(kelvin) for kelvin in trend.temperature_k.get(name, unknown)],
                "tilt_deg": trend.tilt_deg.get(name, unknown),
            }
            for name in sorted(names)
        },
    }


def event(happened: Event) -> Document:
    """One event."""
    return {
        "type": "event", "time_ms": ms(happened.time_ns), "kind": happened.kind.name.lower(),
        "severity": happened.severity.name.lower(), "text": formatting.event_text(happened),
        "stream": happened.stream,
    }  # fmt: skip


def mark(number: int, made: Event, *, counts: bool) -> Document:
    """A mark of a session; `counts` is false if it was taken back."""
    label = str(made.data.get("label", ""))
    words = formatting.event_text(made)
    return {
        "mark": number, "time_ms": ms(made.time_ns), "kind": label, "text": made.text, "words": words,
        "counts": counts,
    }  # fmt: skip


def slope(estimated: SlopeEstimate) -> Document:
    """A slope in words."""
    return {
        "region": estimated.region, "tilt": formatting.tilt(estimated),
        "azimuth": formatting.azimuth(estimated), "words": formatting.state(estimated),
    }  # fmt: skip


def alarms(present: Sequence[Alarm]) -> Document:
    """The alarms that are present, oldest first."""
    return {"type": "alarms", "alarms": [_alarm(alarm) for alarm in present]}


def _alarm(alarm: Alarm) -> Document:
    return {
        "id": alarm.id, "condition": alarm.condition, "subject": alarm.subject,
        "severity": alarm.severity.name.lower(), "since_ms": ms(alarm.since_ns), "text": alarm.text,
        "acknowledged": alarm.acknowledged,
    }  # fmt: skip


def now(latest: Latest, regions_c: Mapping[str, float], bytes_per_s: float) -> Document:
    """How instruments and disk are doing this second; `regions_c` are temperatures in the last frame."""
    health = latest.health
    free = health.disk_free_bytes if health else None
    left_s = free / bytes_per_s if free is not None and bytes_per_s > 0 else None
    return {
        "type": "now", "time_ms": ms(latest.time_ns), "disk_free_bytes": free, "disk_left_s": left_s,
        "bytes": health.written_bytes if health else 0,
        "streams": {name: _present(latest, info, health) for name, info in latest.streams.items()},
        "regions": {name: {"temperature_c": value} for name, value in regions_c.items()},
    }  # fmt: skip


def _present(latest: Latest, info: StreamInfo, health: Health | None) -> Document:
    health_row = latest.stream_health(info.name) if health else None
    values, unit = _values(latest, info)
    return {
        "samples": health_row.received if health_row else 0, "rate_hz": latest.rate_hz(info.name),
        "gaps": latest.gaps.get(info.name, 0), "dropped": health_row.dropped if health_row else 0,
        "rejected": health_row.rejected if health_row else 0,
        "implausible": health_row.implausible if health_row else 0, "age_s": latest.age_s(info.name),
        "value": values[0] if values else None, "values": values, "unit": unit,
    }  # fmt: skip


def _values(latest: Latest, info: StreamInfo) -> tuple[list[float], str]:
    """The channels of a meter's last reading, and their unit, as shown."""
    reading, unit = latest.readings.get(info.name), quantity_of(info).shown
    return [unit.shown_value(value) for value in reading.values] if reading else [], unit.shown


def ms(time_ns: int) -> float:
    """Milliseconds since 1970, to the microsecond."""
    return round(time_ns / 1000) / 1000


def celsius(kelvin: float) -> float:
    """A temperature in °C."""
    return kelvin - CELSIUS_ZERO_K
