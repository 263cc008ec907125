"""Checking a session: nothing is changed, everything that can be known from the file is looked at.

Damage and lost samples are failures; what happened in the field (clouds, lost cables,
stepped clocks) is a warning; the rest is told as it is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fieldkit.model.errors import SessionError
from fieldkit.model.samples import EventKind, Severity
from fieldkit.model.site import RegionKind
from fieldkit.sessions.check_clock import clock_findings
from fieldkit.sessions.check_streams import stream_findings
from fieldkit.sessions.check_sun import sun_findings
from fieldkit.sessions.findings import Finding
from fieldkit.sessions.layout import journal_path
from fieldkit.sessions.reader import Session, open_session
from fieldkit.sessions.seal import crc_of_crcs, table_crc32

_COPY = "take another copy of the session; its numbers may not mean what they did"
_QUIET = {EventKind.START, EventKind.STOP, EventKind.CLOCK_CHECK, EventKind.REGION}


def check(path: str | Path) -> list[Finding]:
    """Everything there is to say about a session file; never raises for what is in it."""
    path = Path(path)
    try:
        session = open_session(path)
    except SessionError as error:
        return [Finding("fail", "file", error.message, error.fix or "")]
    with session:
        findings: list[Finding] = []
        sealed = (_state, integrity_findings, _objects)
        for look in (*sealed, _streams, _events, clock_findings, sun_findings, _regions):
            try:
                findings.extend(look(session))
            except Exception as error:  # whatever stands in the file, the other looks go on
                findings.append(Finding("fail", "file", f"damaged: {error}", f"fieldkit recover {path}"))
        return findings


def _state(session: Session) -> Iterator[Finding]:
    fix = f"fieldkit recover {session.path}"
    match session.state:
        case "sealed":
            yield Finding("ok", "state", "sealed: every sample was compared with the journal")
        case "recovered":
            yield Finding("warn", "state", "recovered after an interruption")
        case "recording":
            yield Finding("warn", "state", "still being recorded; checked as far as it is")
        case _ if journal_path(session.path).exists():
            yield Finding("fail", "state", "interrupted: the journal has samples that the file has not", fix)
        case _:
            yield Finding("fail", "state", "interrupted, and its journal is gone", fix)


def integrity_findings(session: Session) -> Iterator[Finding]:
    """Sealed numbers against what is there; the samples themselves are looked at with their stream."""
    if session.state not in ("sealed", "recovered"):
        return
    sealed = session.integrity()
    for place, name in enumerate(session.streams):
        stored = session.stream(name).column("crc32")
        if len(stored) != sealed["count"][place] or crc_of_crcs(stored) != sealed["crc_of_crcs"][place]:
            yield Finding(
                "fail", name, f"{len(stored)} samples, sealed with {sealed['count'][place]}, or others"
            )
    for name, crc32 in session.sealed_tables().items():
        if table_crc32(session, name) != crc32:
            yield Finding("fail", name, "the table is not as it was sealed")


def _objects(session: Session) -> Iterator[Finding]:
    """Everything that gives the numbers their meaning, against the digests taken when it was sealed."""
    if session.state not in ("sealed", "recovered"):
        return
    if session.format_version == (1, 0):
        text = "sealed by an older version of fieldkit: its header and attributes are under no checksum"
        yield Finding("ok", "header", text)
        return
    sealed = session.sealed_objects()
    if not sealed:
        yield Finding("fail", "header", "the digests it was sealed with are gone", _COPY)
        return
    reasons = {path: _changed(session, path, digest) for path, digest in sealed.items()}
    for path, reason in reasons.items():
        if reason:
            yield Finding("fail", path, reason, _COPY)
    if not any(reasons.values()):
        yield Finding("ok", "header", f"{len(sealed)} objects are as they were sealed")


def _changed(session: Session, path: str, digest: str) -> str:
    """What is wrong with an object, in words."""
    try:
        return "" if session.object_digest(path) == digest else "it is not as it was sealed"
    except Exception as error:  # whatever HDF5 makes of damaged bytes
        return f"it cannot be read: {error}"


def _streams(session: Session) -> Iterator[Finding]:
    for name in session.streams:
        yield from stream_findings(session, name)


def _events(session: Session) -> Iterator[Finding]:
    """What was noticed while recording, one line for each kind of event and stream."""
    events = [event for event in session.events(recorded=True) if event.kind not in _QUIET]
    counts = Counter((event.kind, event.stream) for event in events)
    for (kind, stream), count in counts.items():
        these = [event for event in events if (event.kind, event.stream) == (kind, stream)]
        first = max(these, key=lambda event: event.severity)
        serious = first.severity >= Severity.WARNING
        at = np.datetime64(first.time_ns // 1_000_000_000, "s")
        more = f", and {count - 1} more" if count > 1 else ""
        name = kind.name.lower() + (f" {stream}" if stream else "")
        yield Finding("warn" if serious else "ok", name, f"{at}Z {first.text}{more}")


def _regions(session: Session) -> Iterator[Finding]:
    if not any(info.is_camera for info in session.streams.values()):
        return
    kinds = Counter(region.kind for region in session.regions)
    text = f"references: {kinds[RegionKind.REFERENCE]}, targets: {kinds[RegionKind.TARGET]}"
    if not kinds[RegionKind.REFERENCE]:
        fix = "draw regions in fieldkit.toml (fieldkit roi add) and estimate again"
        yield Finding("warn", "regions", f"{text}; slopes need a reference", fix)
    else:
        yield Finding("ok", "regions", text)
