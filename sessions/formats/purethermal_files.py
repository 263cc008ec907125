r"""Recordings ``*.raw.y16.gz`` of the PureThermal Y16 recorder.

A gzip stream: the signature ``PTY16V1\n``, a little-endian u32 length, a JSON header of that
length; then per frame u64 number, f64 Unix seconds, i64 Unix milliseconds, and the
frame, u16 little-endian. The stamps are arrivals at the recording program. The header
calls the counts kelvin x 100 *if* the camera's TLinear was on.
"""

from __future__ import annotations

import gzip
import json
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Frame, Severity
from fieldkit.sessions.formats.imported import ImportedRecording, explained, flag_bunched
from fieldkit.sessions.formats.times import plausible_ns

SIGNATURE = b"PTY16V1\n"
_RECORD = struct.Struct("<Qdq")
_MAX_HEADER, _MAX_SIDE, _MAX_NUMBER = 1_000_000, 4096, 2**63 - 1
_MAX_RATE_HZ = 1000.0
_LATEST_S = 2**63 / 1e9
_UNREADABLE = (ValueError, KeyError, TypeError, OverflowError, RecursionError, OSError, EOFError, zlib.error)
_PLAUSIBLE_K = (200.0, 700.0)


def is_purethermal(path: Path) -> bool:
    """True if a file is such a recording."""
    try:
        with gzip.open(path) as file:
            return file.read(len(SIGNATURE)) == SIGNATURE
    except (OSError, EOFError, zlib.error):
        return False


def read_purethermal(path: Path, name: str = "camera", *, offset_ns: int = 0) -> ImportedRecording:
    """A recording as a camera stream; a last frame that is cut off is excluded, with a note.

    It is read twice, once for its stamps, and never kept whole. `offset_ns` is added to them. Raises
    `ConfigError` where the file is not such a recording.
    """
    notes: list[tuple[Severity, str]] = []
    time_ns: list[int] = []
    median = float("nan")
    try:
        for frame in _frames(path, name, offset_ns):
            if not time_ns:
                median = float(np.median(frame.counts)) / 100.0
            time_ns.append(frame.time_ns)
    except gzip.BadGzipFile:
        notes.append((Severity.WARNING, f"{path.name} does not match its checksum: frames may be wrong"))
    except (EOFError, OSError, zlib.error):
        notes.append((Severity.WARNING, f"{path.name} ends within frame {len(time_ns)}: it was excluded"))
    scale = 0.01 if _PLAUSIBLE_K[0] <= median <= _PLAUSIBLE_K[1] else float("nan")
    if scale == scale:
        notes.append((Severity.INFO, f"counts taken as K/100: the first frame's median is {median:.1f} K"))
    else:
        notes.append((Severity.WARNING, "the counts are not K/100 (TLinear off): temperatures unknown"))
    with gzip.open(path) as file:
        shape, rate_hz = _header(path, file)
    flagged, bunches = flag_bunched(lambda: _frames(path, name, offset_ns), time_ns)
    info = StreamInfo(
        name, "brightness_temperature", "K", shape, scale,
        rate_hz=rate_hz, driver="import", vendor="GroupGets", model="PureThermal",
    )  # fmt: skip
    return ImportedRecording((info,), flagged, (*notes, *bunches))


def _frames(path: Path, name: str, offset_ns: int) -> Iterator[Frame]:
    """The frames; raises `EOFError`, `OSError` or `zlib.error` where the file ends within one."""
    with gzip.open(path) as file:
        shape, _ = _header(path, file)
        size = 2 * shape[0] * shape[1]
        rows = np.empty((0, 0), "<u2")
        while record := file.read(_RECORD.size):
            data = file.read(size)
            if len(record) < _RECORD.size or len(data) < size:
                raise EOFError
            number, seconds, milliseconds = _RECORD.unpack(record)
            if not 0.0 <= seconds < _LATEST_S or number > _MAX_NUMBER:
                problem = f"was taken at {seconds:g} s after 1970: the file is damaged"
                raise ConfigError(problem, place=f"frame {number}", fix="copy it from the recorder again")
            time_ns = plausible_ns(round(seconds * 1e6) * 1000 + offset_ns)
            counts = np.frombuffer(data, "<u2").reshape(shape)
            yield Frame(name, time_ns, time_ns, counts, rows, device_time=milliseconds, device_seq=number)


def _header(path: Path, file: gzip.GzipFile) -> tuple[tuple[int, int], float]:
    problem = "not a recording of the PureThermal Y16 recorder"
    with explained(
        path, problem, "import a .raw.y16.gz, a folder of 16-bit TIFF, or tables (CSV)", *_UNREADABLE
    ):
        signature, length = file.read(8), int.from_bytes(file.read(4), "little")
        if signature != SIGNATURE or length > _MAX_HEADER:
            raise ValueError("no such signature")
        header = json.loads(file.read(length))
        shape, rate_hz = (int(header["height"]), int(header["width"])), float(header["fps"])
        if not all(0 < side <= _MAX_SIDE for side in shape):
            raise ValueError(f"frames of {shape}")
        if not 0.0 < rate_hz <= _MAX_RATE_HZ:
            raise ValueError(f"{rate_hz} frames a second")
        return shape, rate_hz
