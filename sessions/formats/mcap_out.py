"""A session as one MCAP file: counts, readings, events and slopes as messages by time, with their schemas.

Messages are JSON described by JSON Schema, so that a reader needs nothing of fieldkit's; frames
and events have the names and fields of Foxglove's schemas, which viewers draw at once, and carry
fieldkit's stamps beside them. Bytes are base64; NaN, which JSON lacks, is null.
"""

from __future__ import annotations

import base64
import heapq
import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic_core import to_json

from fieldkit.disk import replacing
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.installation import install_extra
from fieldkit.model.learnt import LearntParameter
from fieldkit.model.samples import NO_COUNTER, Event, Frame, Sample, Severity
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate
from fieldkit.sessions.analysis import channel_names
from fieldkit.sessions.reader import SessionReader

if TYPE_CHECKING:
    from mcap.writer import Writer

_LEVELS = {Severity.INFO: 2, Severity.WARNING: 3, Severity.ERROR: 4}  # as foxglove.Log has them
_INTEGER, _NUMBER, _TEXT = {"type": "integer"}, {"type": ["number", "null"]}, {"type": "string"}
_BYTES = {"type": "string", "contentEncoding": "base64"}
_TIME = {"type": "object", "title": "time", "properties": {"sec": _INTEGER, "nsec": _INTEGER}}
_STAMPS = {
    "timestamp": _TIME,
    "mono_ns": {**_INTEGER, "description": "host monotonic clock at the first byte"},
    "seq": _INTEGER,
    "device_seq": {"type": ["integer", "null"], "description": "the device's own counter, or the kernel's"},
    "device_time": {"type": ["integer", "null"], "description": "the device's own stamp"},
    "flags": {**_INTEGER, "description": "quality flags; meanings in the session file's reference"},
}
_RAW_IMAGE = {
    **_STAMPS,
    "frame_id": _TEXT,
    "width": _INTEGER,
    "height": _INTEGER,
    "encoding": {**_TEXT, "description": "mono16: 16-bit counts, little-endian"},
    "step": {**_INTEGER, "description": "bytes of a row"},
    "data": _BYTES,
    "metadata_rows": {**_BYTES, "description": "rows the camera sent with the frame, same width"},
    "sensor_temperature_k": _NUMBER,
}
_EVENT = {
    "timestamp": _TIME, "level": _INTEGER, "message": _TEXT, "name": _TEXT, "file": _TEXT, "line": _INTEGER,
    "mono_ns": _INTEGER, "kind": _TEXT, "data": {"type": "object"},
}  # fmt: skip
_SLOPE = {
    "timestamp": _TIME, "region": _TEXT, "state": _TEXT, "model": _TEXT, "reason": _TEXT, "minutes": _INTEGER,
    **{field.key: {**_NUMBER, "description": field.description} for field in SLOPE_FIELDS.values()},
}  # fmt: skip

_BY_REGION = {"type": "object", "additionalProperties": _NUMBER}
_LEARNT = {
    "timestamp": _TIME,
    "parameters": {
        "type": "array",
        "items": {
            "type": "object",
            "properties": {
                field.name: _NUMBER if field.type == "float" else _TEXT for field in fields(LearntParameter)
            },
        },
    },
    "residual_k": _BY_REGION,
    "autocorrelation": _BY_REGION,
    "chi_square": _NUMBER,
}


def export_mcap(
    session: SessionReader, folder: Path, *, stream: str | None = None, every: int = 1
) -> list[Path]:
    """One ``.mcap`` with all streams, or the one named; of frames every n-th.

    Raises `ConfigError` where the mcap package is not installed.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise ConfigError("MCAP needs the mcap package", fix=install_extra("lab")) from error
    path = folder / (f"{session.path.stem}.mcap" if stream is None else f"{session.path.stem}-{stream}.mcap")
    names = tuple(session.streams) if stream is None else (session.stream(stream).info.name,)
    with replacing(path, synced=False) as draft, draft.open("wb") as file:
        writer = Writer(file)
        writer.start(library=f"fieldkit {session.provenance['fieldkit_version']}")
        _about(writer, session)
        _messages(writer, session, names, every)
        writer.finish()
    return [path]


def _about(writer: Writer, session: SessionReader) -> None:
    """Facts of the whole session: place, provenance, and the configuration as it was used."""
    header, site = session.header, session.site
    about = {
        "title": header.title, "session_id": session.session_id, "state": session.state,
        "latitude_deg": repr(site.latitude_deg), "longitude_deg": repr(site.longitude_deg),
        "elevation_m": repr(site.elevation_m), "timezone": site.timezone,
        "license": header.license, "references": header.references,
    }  # fmt: skip
    writer.add_metadata("fieldkit session", {**about, **session.provenance})
    start_ns = session.start_ns
    writer.add_attachment(
        start_ns, start_ns, "fieldkit.toml", "application/toml", session.config_toml.encode()
    )


def _messages(writer: Writer, session: SessionReader, names: tuple[str, ...], every: int) -> None:
    """Samples and events by the monotonic clock, then the slopes and what the data taught."""
    channels = {name: _stream_channel(writer, session.streams[name]) for name in names}
    events = _channel(writer, "events", "foxglove.Log", _EVENT, {})
    for item in heapq.merge(session.samples(*names), session.events(), key=lambda item: item.mono_ns):
        if isinstance(item, Event):
            _put(writer, events, item.time_ns, item.mono_ns // 1_000_000, _event(item))
        elif not isinstance(item, Frame) or item.seq % every == 0:
            info = session.streams[item.stream]
            _put(writer, channels[item.stream], item.time_ns, item.seq, _sample(item, info))
    estimates = _channel(writer, "estimates", "fieldkit.Slope", _SLOPE, {})
    for number, estimate in enumerate(session.estimates()):
        _put(writer, estimates, estimate.time_ns, number, _slope(estimate))
    learnt = _channel(writer, "learnt", "fieldkit.Learnt", _LEARNT, {})
    for number, (time_ns, found) in enumerate(session.learnt().items()):
        _put(writer, learnt, time_ns, number, asdict(found))


def _stream_channel(writer: Writer, info: StreamInfo) -> int:
    declared = {
        name: str(getattr(info, name))
        for name in ("quantity", "unit", "scale", "offset", "law", "rate_hz", "driver", "vendor", "model",
                     "serial_number", "firmware", "device_time_unit", "accuracy")
    }  # fmt: skip
    declared["settings"] = json.dumps(dict(info.settings), default=str)
    if info.is_camera:
        return _channel(writer, info.name, "foxglove.RawImage", _RAW_IMAGE, declared)
    values = {name: {**_NUMBER, "description": info.unit} for name in channel_names(info)}
    reading = {**_STAMPS, "values": {"type": "object", "properties": values}, "raw": _BYTES}
    return _channel(writer, info.name, f"fieldkit.Reading.{info.name}", reading, declared)


def _channel(
    writer: Writer, topic: str, schema: str, properties: Mapping[str, Any], about: dict[str, str]
) -> int:
    text = json.dumps({"title": schema, "type": "object", "properties": properties})
    schema_id = writer.register_schema(schema, "jsonschema", text.encode())
    return writer.register_channel(f"/{topic}", "json", schema_id, about)


def _put(writer: Writer, channel: int, time_ns: int, number: int, message: Mapping[str, Any]) -> None:
    stamped = {"timestamp": {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}, **message}
    data = to_json(stamped, inf_nan_mode="null")
    writer.add_message(channel, time_ns, data, time_ns, number % 2**32)


def _sample(sample: Sample, info: StreamInfo) -> dict[str, Any]:
    stamps = {
        "mono_ns": sample.mono_ns, "seq": sample.seq, "device_seq": _counter(sample.device_seq),
        "device_time": _counter(sample.device_time), "flags": int(sample.quality),
    }  # fmt: skip
    if not isinstance(sample, Frame):
        values = dict(zip(channel_names(info), sample.values, strict=True))
        return {**stamps, "values": values, "raw": _base64(sample.raw)}
    rows, cols = sample.counts.shape
    return {
        **stamps,
        "frame_id": sample.stream, "width": cols, "height": rows, "encoding": "mono16", "step": 2 * cols,
        "data": _base64(sample.counts.astype("<u2").tobytes()),
        "metadata_rows": _base64(sample.metadata_rows.astype("<u2").tobytes()),
        "sensor_temperature_k": sample.fpa_temperature_k,
    }  # fmt: skip


def _event(event: Event) -> dict[str, Any]:
    return {
        "level": _LEVELS.get(event.severity, 3), "message": event.text, "name": event.stream,
        "file": "", "line": 0,
        "mono_ns": event.mono_ns, "kind": event.kind.name.lower(), "data": event.data,
    }  # fmt: skip


def _slope(estimate: SlopeEstimate) -> dict[str, Any]:
    numbers = {name: getattr(estimate, name) for name in SLOPE_FIELDS}
    return {
        "region": estimate.region, "state": estimate.state.name.lower(), "model": estimate.model,
        "reason": estimate.reason, "minutes": estimate.n_bins, **numbers,
    }  # fmt: skip


def _counter(value: int) -> int | None:
    return None if value == NO_COUNTER else value


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
