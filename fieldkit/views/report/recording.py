"""The recording in a report: frame and regions, events, streams, clock, provenance."""

from __future__ import annotations

import platform
import tomllib
from collections.abc import Iterable, Mapping
from importlib import metadata
from typing import TYPE_CHECKING

from fieldkit.disk import sha256
from fieldkit.model.device import StreamInfo, regions_on
from fieldkit.model.samples import EventKind, Frame, StreamHealth
from fieldkit.model.site import Region
from fieldkit.model.version import __version__
from fieldkit.palettes import palette
from fieldkit.pixel_axes import ticks
from fieldkit.sessions.finished_file import awake_offsets_ns
from fieldkit.views import formatting
from fieldkit.views import frame_image as image
from fieldkit.views.html import Table, code, data_uri, strong
from fieldkit.views.report.series import ReportData

if TYPE_CHECKING:
    from fieldkit.sessions.reader import SessionReader

PACKAGES = ("numpy", "scipy", "astropy", "h5py", "matplotlib")
SHOWN_EVENTS, UNFOLDED_EVENTS = 200, 12
SIMULATED = "simulated"
_GAPS = (EventKind.GAP, EventKind.LOST)


def frame_image(data: ReportData) -> Mapping[str, object] | None:
    """The frame as ``frame.html`` draws it: image, scale, axes and outlines; None if there is no frame.

    Lengths are in camera pixels: `letter` is the height of the axes' letters.
    """
    if (frame := data.frame) is None:
        return None
    streams = data.session.streams
    info = streams[frame.stream]
    scale = image.scale_of(image.values(frame, info), image.unit(info))
    rows, cols = frame.counts.shape
    shown = regions_on(frame.stream, data.regions, streams.values())
    return {
        "rows": rows,
        "cols": cols,
        "letter": cols / 32,
        "row_ticks": ticks(rows),
        "column_ticks": ticks(cols),
        "data_uri": data_uri("image/png", image.bare_png(frame, info, scale)),
        "low": scale.text(scale.low),
        "middle": scale.text((scale.low + scale.high) / 2),
        "high": scale.text(scale.high),
        "palette": [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in palette()[::8].tolist()],
        "outlines": [_outline(region) for region in shown],
        "region_names": ", ".join(region.name for region in shown) or "none",
        "caption": _frame_caption(data, frame, scale),
    }


def _frame_caption(data: ReportData, frame: Frame, scale: image.Scale) -> str:
    rows, cols = frame.counts.shape
    when = data.clock_time(frame.time_ns, seconds=True)
    zone = formatting.zone_name(frame.time_ns, data.site)
    kind = "Brightness temperature" if scale.unit == "°C" else "Counts"
    return f"{kind} at {when} ({zone}) with the regions; axes in pixels ({cols} x {rows})."


def _outline(region: Region) -> Mapping[str, object]:
    """The corners of a region as SVG points, and its name with the place of its centre."""
    points = " ".join(f"{x:g},{y:g}" for x, y in region.points_px)
    x, y = (sum(side) / len(side) for side in zip(*region.points_px, strict=True))
    return {"name": region.name, "points": points, "x": x, "y": y}


def regions(data: ReportData) -> Table:
    """The regions: kind (and that of their surface, if it is their own), given slope, size and emissivity."""
    kinds = data.settings.kinds
    rows = [
        (
            strong(region.name),
            ", ".join([formatting.kind(region), *([kinds[region.name]] if region.name in kinds else [])]),
            formatting.given_slope(region),
            _pixels(region, data.frame),
            formatting.number(region.emissivity, 2),
        )
        for region in data.regions
    ]
    return Table(("region", "kind", "given tilt/azimuth", "pixels", "own emissivity"), rows)


def _pixels(region: Region, frame: Frame | None) -> str:
    return formatting.UNKNOWN if frame is None else str(int(region.mask(frame.counts.shape).sum()))


def is_simulated(session: SessionReader) -> bool:
    """True if any instrument of the session was simulated, by the configuration that recorded it."""
    if any(info.port == SIMULATED for info in session.streams.values()):
        return True
    try:
        return _names_simulated(tomllib.loads(session.config_toml))
    except tomllib.TOMLDecodeError:  # a damaged configuration is no reason to have no report
        return False


def _names_simulated(settings: object) -> bool:
    """True if a device among nested settings has the simulated port."""
    if isinstance(settings, dict):
        return settings.get("port") == SIMULATED or any(map(_names_simulated, settings.values()))
    return isinstance(settings, list) and any(map(_names_simulated, settings))


# ---------------------------------------------------------------------- events, streams, clock, provenance


def events(data: ReportData) -> Mapping[str, object]:
    """The events in order of time: how many there are, and a table of the first `SHOWN_EVENTS`."""
    rows = [
        (data.clock_time(event.time_ns, seconds=True), event.stream, formatting.event_line(event))
        for event in data.events
    ]
    columns = f"time ({data.zone})", "stream", "what happened"
    table = Table(columns, rows[:SHOWN_EVENTS])
    return {"count": len(rows), "table": table, "is_short": len(rows) <= UNFOLDED_EVENTS}


def streams(data: ReportData) -> Table:
    """The instruments, and what was lost of each."""
    health = list(data.session.health())
    final = {stream.stream: stream for stream in health[-1].streams} if health else {}
    rows = [_stream_row(data, info, final.get(name)) for name, info in data.session.streams.items()]
    columns = ("stream", "instrument", "quantity", "received", "lost", "garbled", "gaps", "implausible")
    return Table(columns, rows)


def _stream_row(data: ReportData, info: StreamInfo, health: StreamHealth | None) -> list[object]:
    instrument = " ".join(part for part in (info.driver, info.vendor, info.model, info.serial_number) if part)
    counts = (health.received, health.dropped, health.rejected) if health else ()
    return [
        strong(info.name),
        instrument or formatting.UNKNOWN,
        f"{info.quantity}, {info.unit}",
        *(map(formatting.number, counts) if counts else [formatting.UNKNOWN] * 3),
        sum(event.stream == info.name for event in data.events_of(*_GAPS)),
        sum(excess.count for excess in data.session.stream(info.name).excesses()),
    ]


def clock(data: ReportData) -> str:
    """Quality of the computer's clock while recording."""
    checks = list(data.session.clock_checks())
    if len(checks) < 2:
        return "The clock was not checked while recording."
    offsets = awake_offsets_ns(checks)  # suspending the computer is not a clock error
    drifts_ms = [float(offset - offsets[0]) / 1e6 for offset in offsets]
    sources = ", ".join(sorted({check.source for check in checks}))
    worst = max(drifts_ms, key=abs)
    good_to_ms = max(check.error_ns for check in checks) / 1e6
    return (
        f"{len(checks)} clock checks ({sources}), each good to {good_to_ms:.2f} ms: the clock drifted from "
        f"recorded times by at most {worst:+.1f} ms (end: {drifts_ms[-1]:+.1f} ms). A minute equals 0.25° of "
        "sun. Recorded times were not changed."
    )


def provenance(data: ReportData) -> Table:
    """Provenance of the numbers: file and checksum, versions, command lines."""
    session = data.session
    rows: list[tuple[object, object]] = [
        ("session file", code(session.path.name)),
        ("state", session.state),
        ("SHA-256", code(sha256(session.path))),
        ("recorded by", code(session.header.command_line or formatting.UNKNOWN)),
        ("report by", code(data.command_line or formatting.UNKNOWN)),
        ("versions", ", ".join(versions())),
        ("Python", f"{platform.python_version()} on {platform.platform()}"),
        ("estimator", f"{data.settings.method}, model {data.settings.model}"),
        ("minutes", "as recorded" if data.is_recordings else "computed again from the stored samples"),
    ]
    credits = ((name, getattr(session.header, name)) for name in ("operator", "license", "references"))
    rows += [(name, value) for name, value in credits if value]
    return Table(("", ""), rows)


def versions() -> Iterable[str]:
    """The packages that had a part in the numbers, with their versions."""
    yield f"fieldkit {__version__}"
    for package in PACKAGES:
        try:
            yield f"{package} {metadata.version(package)}"
        except metadata.PackageNotFoundError:
            yield f"{package} absent"
