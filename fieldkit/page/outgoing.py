"""Messages to browsers: JSON documents of a recording's latest state.

Times are UTC milliseconds (`time_ms`), temperatures °C, unknown numbers null.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from fieldkit.config.toml_schema import RegionOutline
from fieldkit.estimation.estimator import Minute
from fieldkit.model.alarm import Alarm
from fieldkit.model.channels import quantity_of
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, Quality, StreamHealth
from fieldkit.model.site import Region
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.phrases import LANGUAGES, in_language, text_of
from fieldkit.results.json_document import attributes
from fieldkit.views import formatting
from fieldkit.views.latest import Latest, Trend

Document = dict[str, Any]


def in_all_languages(text: str) -> dict[str, str]:
    """A text by the languages of browsers, for all of which a message is encoded once."""
    return {language: in_language(text, language) for language in LANGUAGES}


def streams(infos: Sequence[StreamInfo], missing: Sequence[str]) -> Document:
    """The instruments, and the names of configured ones that are missing."""
    return {"type": "streams", "streams": [_stream(info) for info in infos], "missing": missing}


def _stream(info: StreamInfo) -> Document:
    rows, cols = info.shape if info.is_camera else (0, 0)
    return attributes(info, "name", "quantity", "is_camera", "channels") | {"rows": rows, "cols": cols}


def regions(regions: Sequence[Region]) -> Document:
    """The regions with their corners in pixels."""
    outlines = [RegionOutline.of(region).model_dump() for region in regions]
    return {"type": "regions", "regions": outlines}


def minute(closed: Minute) -> Document:
    """A minute bin: irradiance, sun, contact temperatures, and each region's temperature and slope."""
    slopes = {estimate.region: estimate for estimate in closed.estimates}
    names = {**closed.temperature_k, **slopes}
    return {
        "type": "minute",
        "time_ms": ms(closed.time_ns),
        "cloudy": Quality.CLOUD in closed.flags,
        "irradiance": {"dni_w_m2": closed.dni_w_m2, "model": closed.irradiance_model},
        "sun": {"zenith_deg": closed.sun_zenith_deg, "azimuth_deg": closed.sun_azimuth_deg},
        "contact_c": [celsius(kelvin) for kelvin in closed.contact_k],
        "regions": {name: _measurements(closed, name, slopes.get(name)) for name in names},
    }


def _measurements(closed: Minute, name: str, estimate: SlopeEstimate | None) -> Document:
    temperature = {"temperature_c": celsius(closed.temperature_k.get(name, math.nan))}
    if estimate is None:
        return {**temperature, "state": "reference"}
    return temperature | slope(estimate) | {"shaded": Quality.SHADED in estimate.flags}


def history(trend: Trend) -> Document:
    """Temperature and tilt of every region in every minute so far, with clouds and shade."""
    regions: Document = {}
    for key, column in trend.columns.items():
        for name in sorted(column):
            values = column[name]
            is_kelvin = key == "temperature_k"
            pair = ("temperature_c", list(map(celsius, values))) if is_kelvin else (key, values)
            regions.setdefault(name, {}).update([pair])
    minutes = [ms(time_ns) for time_ns in trend.times_ns]
    return {"type": "history", "minutes": minutes, "cloudy": trend.cloudy, "regions": regions}


def event(happened: Event) -> Document:
    """One event: its words follow from kind and data; `text` is what the session keeps."""
    document = {"type": "event", **happened.document()}
    if refusals := happened.data.get("refusals"):
        document["data"]["refusals"] = in_all_languages(text_of(refusals))
    return document


def mark(number: int, event: Event, *, counts: bool) -> Document:
    """A mark of a session; `counts` is false if it was taken back."""
    texts = {"kind": str(event.data.get("label", "")), "text": event.text}
    times = {"time_ms": ms(event.time_ns), "end_ms": ms(int(event.data.get("end_ns", event.time_ns)))}
    return {"mark": number, **times, **texts, "counts": counts}


def slope(estimated: SlopeEstimate) -> Document:
    """A slope."""
    angles = {key: getattr(estimated, key) for key in SLOPE_FIELDS}
    state = {"region": estimated.region, "state": estimated.state.name.lower()}
    ranges = {"tilt": formatting.tilt(estimated), "azimuth": formatting.azimuth(estimated)}
    return state | ranges | angles


def alarms(present: Sequence[Alarm]) -> Document:
    """The alarms that are present, oldest first."""
    return {"type": "alarms", "alarms": [_alarm(alarm) for alarm in present]}


def _alarm(alarm: Alarm) -> Document:
    row = attributes(alarm, "id", "condition", "subject", "text", "acknowledged")
    return {**row, "severity": alarm.severity.name.lower(), "since_ms": ms(alarm.since_ns)}


def now(latest: Latest, regions_c: Mapping[str, float], bytes_per_s: float) -> Document:
    """How instruments and disk are doing this second; `regions_c` are temperatures in the last frame."""
    health = latest.health
    free = health.disk_free_bytes if health else None
    left_s = free / bytes_per_s if free is not None and bytes_per_s > 0 else None
    size = {"disk_free_bytes": free, "disk_left_s": left_s, "bytes": health.written_bytes if health else 0}
    streams = {name: _present(latest, info) for name, info in latest.streams.items()}
    regions = {name: {"temperature_c": value} for name, value in regions_c.items()}
    return {"type": "now", "time_ms": ms(latest.time_ns), **size, "streams": streams, "regions": regions}


def _present(latest: Latest, info: StreamInfo) -> Document:
    health = latest.stream_health(info.name) or StreamHealth(info.name, received=0, dropped=0, queued=0)
    counts = attributes(health, "dropped", "rejected", "implausible")
    counts |= {"samples": health.received, "gaps": latest.gaps.get(info.name, 0)}
    values, unit = _values(latest, info)
    reading = {"value": values[0] if values else None, "unit": unit}
    return {**counts, "rate_hz": latest.rate_hz(info.name), "age_s": latest.age_s(info.name), **reading}


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
