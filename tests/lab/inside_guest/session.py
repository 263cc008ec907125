"""What a recorded session holds, put into plain numbers inside the guest so that only those travel."""

from __future__ import annotations

import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fieldkit.model.errors import FieldkitError
from fieldkit.model.samples import Frame, Quality, Reading
from fieldkit.sessions.reader import open_session

EVENT_KEYS = ("stream", "text", "mono_ns")


def newest_ns(folder: str, stream: str) -> int:
    """Monotonic stamp of the newest sample of a stream in the session a campaign is recording; 0 for none."""
    paths = sorted(Path(folder, "recordings").glob("*.h5"))
    if not paths:
        return 0
    try:
        with open_session(paths[-1]) as session:
            count = session.count(stream)
            return int(session.stream(stream).time_ns(count - 1)[0]) - session.anchor_ns if count else 0
    except (FieldkitError, OSError):  # its first bytes are being written
        return 0


def summary(path: str) -> dict[str, Any]:
    """State, streams, events and estimates of a session."""
    with open_session(Path(path)) as session:
        streams = {
            name: {"info": _info(info), **_samples(session, name)} for name, info in session.streams.items()
        }
        return {
            "state": session.state,
            "start_ns": session.start_ns,
            "end_ns": session.end_ns,
            "streams": streams,
            "events": [
                {"kind": event.kind.name, **{key: getattr(event, key) for key in EVENT_KEYS}}
                for event in session.events()
            ],
            "estimates": [
                [one.region, one.state.name, one.tilt_deg, one.azimuth_deg] for one in session.estimates()
            ],
        }


def _info(info: Any) -> dict[str, Any]:
    return {"identity": info.identity, "settings": dict(info.settings)}


def _samples(session: Any, name: str) -> dict[str, Any]:
    samples = list(session.samples(name))
    pictures = [sample for sample in samples if isinstance(sample, Frame)]
    repeats = [new for old, new in pairwise(pictures) if np.array_equal(new.counts, old.counts)]
    return {
        "count": len(samples),
        "stamps_ns": [sample.mono_ns for sample in samples],
        "counters": [picture.device_seq for picture in pictures],
        "sums": [
            zlib.crc32(picture.counts.tobytes() + picture.metadata_rows.tobytes()) for picture in pictures
        ],
        "values": [list(sample.values) for sample in samples if isinstance(sample, Reading)],
        "flags": [[flag.name for flag in Quality if flag and flag in sample.quality] for sample in samples],
        "unflagged_duplicates": sum(Quality.DUPLICATE not in picture.quality for picture in repeats),
    }
