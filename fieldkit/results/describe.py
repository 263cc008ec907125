"""Description of a session, in one document; `describe_briefly` of a file, readable or not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fieldkit.model.channels import radiation_components
from fieldkit.model.durations import precise_duration
from fieldkit.model.errors import SessionError
from fieldkit.model.learnt import Learnt
from fieldkit.model.site import Site
from fieldkit.model.slope import SlopeEstimate, final_estimates
from fieldkit.results.json_document import learnt_document
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import SessionReader, open_session
from fieldkit.views import formatting
from fieldkit.views.formatting import by_time


def describe(session: SessionReader) -> dict[str, Any]:
    """Description of a session, as ``fieldkit show --json`` prints it."""
    site = session.site
    return {
        "session": str(session.path), "title": session.header.title, "state": session.state,
        "site": {
            "latitude_deg": site.latitude_deg, "longitude_deg": site.longitude_deg,
            "elevation_m": site.elevation_m, "timezone": site.timezone,
            "body": site.body,
        },
        "began": local_time(site, session.start_ns), "ended": local_time(site, session.end_ns),
        "start": iso_time(site, session.start_ns), "end": iso_time(site, session.end_ns),
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
                "region": slope.region, "at": local_time(site, slope.time_ns),
                "state": slope.state.name.lower(),
                "tilt_deg": slope.tilt_deg, "azimuth_deg": slope.azimuth_deg, "model": slope.model,
            }
            for slope in recorded_slopes(session)
        ],
        "learnt": learnt_document(recorded_learnt(session)),
        "events": [
            {
                "at": local_time(site, event.time_ns), "kind": event.kind.name.lower(),
                "stream": event.stream, "text": event.text, "label": str(event.data.get("label", "")),
                "end": local_time(site, int(event.data.get("end_ns", 0))),
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
    """Parameters learnt at the end of the recording, or None if nothing."""
    return next(reversed(session.learnt().values()), None)


def _stream(session: SessionReader, name: str) -> dict[str, Any]:
    info = session.streams[name]
    return {
        "name": name, "quantity": info.quantity, "unit": info.unit, "shape": list(info.shape),
        "samples": session.count(name), "driver": info.driver,
        "device": " ".join(word for word in (info.vendor, info.model, info.serial_number) if word),
        "rate_hz": info.rate_hz, "measures": list(radiation_components(info, {})),
    }  # fmt: skip


def describe_briefly(path: Path) -> dict[str, Any]:
    """State, time and counts of a session file, readable or not, as ``fieldkit ls --json`` prints them."""
    try:
        with open_session(path) as session:
            counts = {name: session.count(name) for name in session.streams}
            times_ns, title = (session.start_ns, session.end_ns), session.header.title
            return brief(path, session.state, session.site, *times_ns, counts, title)
    except SessionError as error:
        state = "interrupted" if journal_path(path).exists() else "unreadable"
        unknown = {"began": "", "length": "", "samples": {}, "bytes": _size(path)}
        return {"name": path.name, "state": state, **unknown, "problem": error.message}


def brief(
    path: Path, state: str, site: Site, start_ns: int, end_ns: int, counts: Mapping[str, int], title: str
) -> dict[str, Any]:
    """The same of what is known of a session."""
    length_s = (end_ns - start_ns) / 1e9
    return {
        "name": path.name, "state": state, "began": local_time(site, start_ns),
        "start": iso_time(site, start_ns), "end": iso_time(site, end_ns),
        "length": precise_duration(length_s), "length_s": length_s,
        "samples": counts, "bytes": _size(path), "title": title,
    }  # fmt: skip


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def local_time(site: Site, time_ns: int) -> str:
    """A moment in the site's zone, which is named; empty for none."""
    return formatting.local_time(time_ns, site).strftime("%Y-%m-%d %H:%M:%S %Z") if time_ns else ""


def iso_time(site: Site, time_ns: int) -> str | None:
    """A moment as ISO 8601 with the site's offset; None for none."""
    return formatting.local_time(time_ns, site).isoformat() if time_ns else None
