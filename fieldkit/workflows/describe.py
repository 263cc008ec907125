"""What a session is and holds, in one document; `describe_briefly` of a file, readable or not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fieldkit.model.errors import SessionError
from fieldkit.model.learnt import Learnt
from fieldkit.model.radiation import measured
from fieldkit.model.slope import SlopeEstimate, final_estimates
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.views import formatting
from fieldkit.views.formatting import by_time
from fieldkit.workflows.json_document import learnt_document


def describe(session: SessionReader) -> dict[str, Any]:
    """What a session is and holds, as ``fieldkit show --json`` prints it."""
    return {
        "session": str(session.path), "title": session.header.title, "state": session.state,
        "site": {
            "latitude_deg": session.site.latitude_deg, "longitude_deg": session.site.longitude_deg,
            "elevation_m": session.site.elevation_m, "timezone": session.site.timezone,
            "body": session.site.body,
        },
        "began": local_time(session, session.start_ns), "ended": local_time(session, session.end_ns),
        "start": iso_time(session, session.start_ns), "end": iso_time(session, session.end_ns),
        "length_s": (session.end_ns - session.start_ns) / 1e9,
        "streams": [_stream(session, name) for name in session.streams],
        "regions": [
            {
                "name": region.name, "kind": region.kind.name.lower(), "tilt_deg": region.tilt_deg,
                "azimuth_deg": region.azimuth_deg, "corners": len(region.vertices),
            }
            for region in session.regions
        ],
        "slopes": [
            {
                "region": one.region, "at": local_time(session, one.time_ns), "state": one.state.name.lower(),
                "tilt_deg": one.tilt_deg, "azimuth_deg": one.azimuth_deg, "model": one.model,
            }
            for one in recorded_slopes(session)
        ],
        "learnt": learnt_document(recorded_learnt(session)),
        "events": [
            {
                "at": local_time(session, event.time_ns), "kind": event.kind.name.lower(),
                "stream": event.stream, "text": event.text, "label": str(event.data.get("label", "")),
                "end": local_time(session, int(event.data.get("end_ns", 0))),
            }
            for event in by_time(session.events())
        ],
        "operator": session.header.operator, "description": session.header.description,
        "license": session.header.license, **session.provenance,
    }  # fmt: skip


def recorded_slopes(session: SessionReader) -> list[SlopeEstimate]:
    """The final estimate of each target, as recorded."""
    return list(final_estimates(session.estimates(), session.regions).values())


def recorded_learnt(session: SessionReader) -> Learnt | None:
    """What the data had taught at the end of the recording, or None if nothing."""
    return next(reversed(session.learnt().values()), None)


def _stream(session: SessionReader, name: str) -> dict[str, Any]:
    info = session.streams[name]
    return {
        "name": name, "quantity": info.quantity, "unit": info.unit, "shape": list(info.shape),
        "samples": session.count(name), "driver": info.driver,
        "device": " ".join(word for word in (info.vendor, info.model, info.serial_number) if word),
        "rate_hz": info.rate_hz, "measures": list(measured(info, {})),
    }  # fmt: skip


def describe_briefly(path: Path) -> dict[str, Any]:
    """State, time and counts of a session file, readable or not, as ``fieldkit ls --json`` prints them."""
    size = path.stat().st_size if path.exists() else 0
    try:
        with open_session(path) as session:
            counts = {name: session.count(name) for name in session.streams}
            length_s = (session.end_ns - session.start_ns) / 1e9
            return {
                "name": path.name, "state": session.state, "began": local_time(session, session.start_ns),
                "start": iso_time(session, session.start_ns), "end": iso_time(session, session.end_ns),
                "length": formatting.precise_duration(length_s), "length_s": length_s,
                "samples": counts, "bytes": size, "title": session.header.title,
            }  # fmt: skip
    except SessionError as error:
        waits = path.with_name(path.name + ".journal").exists()
        state = "interrupted" if waits else "unreadable"
        unknown = {"began": "", "length": "", "samples": {}, "bytes": size}
        return {"name": path.name, "state": state, **unknown, "problem": error.message}


def local_time(session: SessionReader, time_ns: int) -> str:
    """A moment in the site's zone, which is named; empty for none."""
    if not time_ns:
        return ""
    return formatting.local_time(time_ns, session.site).strftime("%Y-%m-%d %H:%M:%S %Z")


def iso_time(session: SessionReader, time_ns: int) -> str | None:
    """A moment as ISO 8601 with the site's offset; None for none."""
    return formatting.local_time(time_ns, session.site).isoformat() if time_ns else None
