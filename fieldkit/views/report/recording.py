"""Sections on the recording itself: picture and regions, events, streams, clock, provenance."""

from __future__ import annotations

import base64
import hashlib
import platform
from collections.abc import Iterable
from html import escape
from importlib import metadata
from pathlib import Path

from fieldkit.model.samples import EventKind, Frame
from fieldkit.model.site import Region
from fieldkit.pixel_axes import ticks
from fieldkit.sessions.clock_correction import awake_offsets_ns
from fieldkit.views import formatting, frame_image
from fieldkit.views.html import Html, element, paragraph, section, table
from fieldkit.views.report.report_data import Material

PACKAGES = ("fieldkit", "numpy", "scipy", "astropy", "h5py", "matplotlib")
QUIET_EVENTS = 200
_LEFT, _BELOW = 2.2, 1.4
"""Room for the numbers of the axes, in letters of the picture."""
_GAPS = (EventKind.GAP, EventKind.LOST)


def seen(material: Material) -> Html:
    """The picture with its regions, and what the regions are."""
    regions = material.regions
    rows = [
        (
            element("strong", region.name),
            formatting.kind(region),
            formatting.given_slope(region),
            _pixels(region, material.frame),
            formatting.number(region.emissivity, 2),
        )
        for region in regions
    ]
    names = table(("region", "kind", "given tilt/azimuth", "pixels", "own emissivity"), rows)
    return section("Picture and regions", _picture(material), names)


def _pixels(region: Region, frame: Frame | None) -> str:
    return formatting.UNKNOWN if frame is None else str(int(region.mask(frame.counts.shape).sum()))


def _picture(material: Material) -> Html:
    frame = material.frame
    if frame is None:
        return paragraph("No picture without doubts was recorded.")
    info = material.session.streams[frame.stream]
    scale = frame_image.scale_of(frame_image.values(frame, info), frame_image.unit(info))
    data = base64.b64encode(frame_image.bare_png(frame, info, scale)).decode()
    rows, cols = frame.counts.shape
    size = cols / 32
    outlines = "".join(_outline(region, size) for region in material.regions)
    names = ", ".join(region.name for region in material.regions) or "none"
    svg = (
        f'<svg viewBox="{-0.5 - _LEFT * size:g} {-0.5 - 0.6 * size:g} {cols + (_LEFT + 0.6) * size:g} '
        f'{rows + (_BELOW + 3.2) * size:g}" role="img" xmlns="http://www.w3.org/2000/svg" '
        f'aria-label="Thermal picture from {scale.text(scale.low)} to {scale.text(scale.high)}; '
        f'regions: {escape(names)}">'
        f'<image x="-0.5" y="-0.5" width="{cols}" height="{rows}" style="image-rendering:pixelated" '
        f'href="data:image/png;base64,{data}"/>{_axes(cols, rows, size)}{outlines}'
        f"{_scale_bar(scale, cols, rows + _BELOW * size, size)}</svg>"
    )
    when = material.when(frame.time_ns, seconds=True)
    zone = formatting.zone_name(frame.time_ns, material.site)
    kind = "Brightness temperature" if scale.unit == "°C" else "Counts"
    return element(
        "figure",
        Html(svg),
        element(
            "figcaption",
            f"{kind} at {when} ({zone}), as the camera saw it, with the regions. "
            f"The axes count its {cols} x {rows} pixels, as fieldkit roi does.",
        ),
        class_="picture",
    )


def _outline(region: Region, size: float) -> str:
    points = " ".join(f"{x:g},{y:g}" for x, y in region.vertices)
    middle_x, middle_y = (sum(side) / len(side) for side in zip(*region.vertices, strict=True))
    stroke = 'fill="none" stroke-linejoin="round"'
    label = (
        f'x="{middle_x:g}" y="{middle_y + 0.4 * size:g}" font-size="{1.1 * size:g}" text-anchor="middle" '
        'font-weight="bold" font-family="sans-serif"'
    )
    # Twice, because makers of PDF do not know how to paint the stroke of a text under its filling.
    return (
        f'<polygon points="{points}" {stroke} stroke="#000" stroke-width="{0.25 * size:g}"/>'
        f'<polygon points="{points}" {stroke} stroke="#0dd" stroke-width="{0.12 * size:g}"/>'
        f'<text {label} {stroke} stroke="#000" stroke-width="{0.25 * size:g}" aria-hidden="true">'
        f"{escape(region.name)}</text>"
        f'<text {label} fill="#fff">{escape(region.name)}</text>'
    )


def _axes(cols: int, rows: int, size: float) -> str:
    """Numbers of camera pixels on the left and below, and a faint grid through them."""
    line = f'stroke="#fff" stroke-opacity="0.35" stroke-width="{0.05 * size:g}"'
    letters = f'font-size="{size:g}" font-family="sans-serif"'
    across = "".join(
        f'<path d="M{x:g} -0.5V{rows - 0.5:g}" {line}/>'
        f'<text x="{x:g}" y="{rows + 0.9 * size:g}" text-anchor="middle" {letters}>{x}</text>'
        for x in ticks(cols)
    )
    down = "".join(
        f'<path d="M-0.5 {y:g}H{cols - 0.5:g}" {line}/>'
        f'<text x="{-0.5 - 0.3 * size:g}" y="{y + 0.35 * size:g}" text-anchor="end" {letters}>{y}</text>'
        for y in ticks(rows)
    )
    return across + down


def _scale_bar(scale: frame_image.Scale, cols: int, rows: float, size: float) -> str:
    """The palette under the picture with its first, middle and last value."""
    steps = frame_image.palette()[::8]
    width = cols / len(steps)
    bar = "".join(
        f'<rect x="{i * width - 0.5:g}" y="{rows:g}" width="{width * 1.05:g}" height="{0.8 * size:g}" '
        f'fill="#{red:02x}{green:02x}{blue:02x}"/>'
        for i, (red, green, blue) in enumerate(steps.tolist())
    )
    middle = (scale.low + scale.high) / 2
    marks = ((0.0, "start", scale.low), (cols / 2, "middle", middle), (cols - 1.0, "end", scale.high))
    letters = "".join(
        f'<text x="{x:g}" y="{rows + 2.1 * size:g}" font-size="{1.1 * size:g}" font-family="sans-serif" '
        f'text-anchor="{anchor}">{scale.text(value)}</text>'
        for x, anchor, value in marks
    )
    return bar + letters


# ---------------------------------------------------------------------- what happened


def events(material: Material) -> Html:
    """What happened, in order of time, folded away when it is long."""
    rows = [(material.when(e.time_ns, seconds=True), e.stream, formatting.told(e)) for e in material.events]
    if not rows:
        return section("Events", paragraph("Nothing happened that was worth an event."))
    zone = formatting.zone_name(material.events[0].time_ns, material.site)
    shown = table((f"time ({zone})", "stream", "what happened"), rows[:QUIET_EVENTS])
    if len(rows) <= 12:
        return section("Events", shown)
    more = "" if len(rows) <= QUIET_EVENTS else f", the first {QUIET_EVENTS} shown"
    folded = element("details", element("summary", f"{len(rows)} events{more}"), shown, class_="printed")
    return section("Events", folded)


def streams(material: Material) -> Html:
    """The instruments, and what was lost of each."""
    health = list(material.session.health())
    last = {stream.stream: stream for stream in health[-1].streams} if health else {}
    rows = []
    for name, info in material.session.streams.items():
        made = " ".join(part for part in (info.driver, info.vendor, info.model, info.serial_number) if part)
        stream = last.get(name)
        gaps = sum(event.stream == name for event in material.events_of(*_GAPS))
        rows.append(
            (
                element("strong", name),
                made or formatting.UNKNOWN,
                f"{info.quantity}, {info.unit}",
                formatting.number(stream.received) if stream else formatting.UNKNOWN,
                formatting.number(stream.dropped) if stream else formatting.UNKNOWN,
                formatting.number(stream.rejected) if stream else formatting.UNKNOWN,
                gaps,
            )
        )
    columns = ("stream", "instrument", "quantity", "received", "lost", "garbled", "gaps")
    return section("Instruments and gaps", table(columns, rows))


def clock(material: Material) -> Html:
    """How well the computer's clock kept UTC while recording."""
    checks = list(material.session.clock_checks())
    if len(checks) < 2:
        return section("Clock", paragraph("The clock was not checked while recording."))
    offsets = awake_offsets_ns(checks)  # a sleep is no error of the clock
    drifts_ms = [float(offset - offsets[0]) / 1e6 for offset in offsets]
    sources = ", ".join(sorted({check.source for check in checks}))
    worst = max(drifts_ms, key=abs)
    good_to_ms = max(check.error_ns for check in checks) / 1e6
    return section(
        "Clock",
        paragraph(
            f"{len(checks)} checks against {sources}. Since the start UTC and the monotonic counter moved "
            f"apart by at most {worst:+.1f} ms (end: {drifts_ms[-1]:+.1f} ms); each check is good to "
            f"{good_to_ms:.2f} ms or better. A minute would be 0.25° of sun. Recorded times were not changed."
        ),
    )


def provenance(material: Material) -> Html:
    """Where the numbers come from: file and checksum, versions, command lines, configuration."""
    session = material.session
    rows: list[tuple[object, object]] = [
        ("session file", element("code", session.path.name)),
        ("state", session.state),
        ("SHA-256", element("code", sha256(session.path))),
        ("recorded by", element("code", session.header.command_line or formatting.UNKNOWN)),
        ("report by", element("code", material.command_line or formatting.UNKNOWN)),
        ("versions", ", ".join(versions())),
        ("Python", f"{platform.python_version()} on {platform.platform()}"),
        ("estimator", f"{material.settings.method}, model {material.settings.model}"),
    ]
    said = ((name, getattr(session.header, name)) for name in ("operator", "license", "references"))
    rows += [(name, value) for name, value in said if value]
    config = element(
        "details", element("summary", "Configuration in force"), element("pre", material.config_toml)
    )
    return section("Provenance", table(("", ""), rows), config if material.config_toml else "")


def sha256(path: Path) -> str:
    """Checksum of a file, read a megabyte at a time."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def versions() -> Iterable[str]:
    """The packages that had a part in the numbers, with their versions."""
    for package in PACKAGES:
        try:
            yield f"{package} {metadata.version(package)}"
        except metadata.PackageNotFoundError:
            yield f"{package} absent"
