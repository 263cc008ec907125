"""Description of a session, in one document; `describe_briefly` of a file, readable or not."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.channels import radiation_components
from fieldkit.model.durations import precise_duration
from fieldkit.model.errors import SessionError
from fieldkit.model.learnt import Learnt
from fieldkit.model.samples import Event
from fieldkit.model.site import Region, Site
from fieldkit.model.slope import WITH_SLOPE, SlopeEstimate, SlopeState, final_estimates, final_rows
from fieldkit.results.json_document import attributes, learnt_document
from fieldkit.results.sources import TABLES
from fieldkit.sessions.layout import decode_text
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import SessionOutline, SessionReader, open_as
from fieldkit.views import formatting

_BRIEF_ANGLES = ("tilt_deg", "tilt_low_deg", "tilt_high_deg", "azimuth_deg")


def describe(session: SessionReader) -> dict[str, Any]:
    """Description of a session, as ``fieldkit show --json`` prints it."""
    site = session.site
    return {
        "session": str(session.path),
        **attributes(session.header, "title", "operator", "description", "license"),
        "state": session.state,
        "site": asdict(site),
        **_interval(site, session.start_ns, session.end_ns),
        "ended": local_time(site, session.end_ns),
        "streams": [_stream(session, name) for name in session.streams],
        "regions": [_region(region) for region in session.regions],
        "slopes": [_slope(slope, session) for slope in recorded_slopes(session)],
        "learnt": learnt_document(recorded_learnt(session)),
        "events": [_event(event, site) for event in formatting.by_time(session.events())],
        **session.provenance,
    }


def _interval(site: Site, start_ns: int, end_ns: int) -> dict[str, Any]:
    """Begin, end and length of a session."""
    iso = {"start": iso_time(site, start_ns), "end": iso_time(site, end_ns)}
    return {"began": local_time(site, start_ns), **iso, "length_s": (end_ns - start_ns) / 1e9}


def _region(region: Region) -> dict[str, Any]:
    measured = attributes(region, "name", "tilt_deg", "azimuth_deg")
    return {**measured, "kind": region.kind.name.lower(), "corners": len(region.points_px)}


def _slope(slope: SlopeEstimate, session: SessionReader) -> dict[str, Any]:
    angles = attributes(slope, "region", "tilt_deg", "azimuth_deg", "model")
    time_ns = min(slope.time_ns, session.end_ns)  # the middle of a last part of a minute may be after the end
    return {**angles, "at": local_time(session.site, time_ns), "state": slope.state.name.lower()}


def _event(event: Event, site: Site) -> dict[str, Any]:
    times = {"at": local_time(site, event.time_ns), "end": local_time(site, int(event.data.get("end_ns", 0)))}
    label = str(event.data.get("label", ""))
    return {**times, "kind": event.kind.name.lower(), **attributes(event, "stream", "text"), "label": label}


def recorded_slopes(session: SessionReader) -> list[SlopeEstimate]:
    """The final estimate of each target, as recorded."""
    return list(final_estimates(session.estimates(), session.regions).values())


def recorded_learnt(session: SessionReader) -> Learnt | None:
    """Parameters learnt at the end of the recording, or None if nothing."""
    return next(reversed(session.learnt().values()), None)


def _stream(session: SessionReader, name: str) -> dict[str, Any]:
    info = session.streams[name]
    device = " ".join(filter(None, (info.vendor, info.model, info.serial_number)))
    measures = list(radiation_components(info, {}))
    stated = attributes(info, "name", "quantity", "unit", "shape", "driver", "rate_hz")
    return {**stated, "samples": session.count(name), "device": device, "measures": measures}


def describe_briefly(path: Path) -> dict[str, Any]:
    """State, time and counts of a session file, readable or not, as ``fieldkit ls --json`` prints them."""
    try:
        with open_as(SessionOutline, path) as session:
            counts = {name: session.count(name) for name in session.streams}
            times_ns, title = (session.start_ns, session.end_ns), session.header.title
            return {
                **brief(path, session.state, session.site, *times_ns, counts, title),
                "fieldkit_version": session.written_by,
                "settings": settings_digest(session.config_toml),
                "regions": _brief_regions(session),
            }
    except SessionError as error:
        state = "interrupted" if journal_path(path).exists() else "unreadable"
        unknown = {"began": "", "length": "", "samples": {}, "bytes": _size(path), "regions": []}
        return {"name": path.name, "state": state, **unknown, "problem": error.message}


def brief(
    path: Path, state: str, site: Site, start_ns: int, end_ns: int, counts: Mapping[str, int], title: str
) -> dict[str, Any]:
    """The same of what is known of a session that is being recorded: it has no final slopes yet."""
    interval = _interval(site, start_ns, end_ns)
    interval["length"] = precise_duration(interval["length_s"])
    size = {"samples": counts, "bytes": _size(path)}
    return {"name": path.name, "state": state, **interval, **size, "title": title, "regions": []}


@cache  # the sessions of a campaign have a few configurations
def settings_digest(config_toml: str) -> str:
    """Twelve hexadecimal digits of a digest of the settings that an estimate depends on; empty without."""
    try:
        tables = tomllib.loads(config_toml)
    except ValueError:  # of an imported session it may be anything
        return ""
    settings = json.dumps({name: tables.get(name) for name in TABLES}, sort_keys=True, default=str)
    return hashlib.sha256(settings.encode()).hexdigest()[:12]


def _brief_regions(session: SessionOutline) -> list[dict[str, Any]]:
    """The final slope of each target, in the order of the recording."""
    table = session.table("estimates", "region", "state", *_BRIEF_ANGLES)
    final = final_rows(table["region"].tolist(), np.isin(table["state"], WITH_SLOPE).tolist())
    known_deg = {region.name: region.tilt_deg for region in session.header.regions}
    return [
        {
            "region": (name := decode_text(region)),
            "state": SlopeState(int(table["state"][row])).name.lower(),
            **{angle: _number(table[angle][row]) for angle in _BRIEF_ANGLES},
            "true_tilt_deg": _number(known_deg.get(name, math.nan)),
        }
        for region, row in final.items()
    ]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def local_time(site: Site, time_ns: int) -> str:
    """A moment in the site's zone, which is named; empty for none."""
    return formatting.local_time(time_ns, site).strftime("%Y-%m-%d %H:%M:%S %Z") if time_ns else ""


def iso_time(site: Site, time_ns: int) -> str | None:
    """A moment as ISO 8601 with the site's offset; None for none."""
    return formatting.local_time(time_ns, site).isoformat() if time_ns else None
