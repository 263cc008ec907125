"""One screen of a recording, drawn from what is known now: fits 80x24 and grows with the terminal.

Pure drawing: a `Latest` and a size in, something rich can print out. From top to bottom: title
and time, image beside the instruments, one line per region, the last events, progress.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from rich.color import Color
from rich.console import Console, Group, RenderableType
from rich.layout import Layout
from rich.progress_bar import ProgressBar
from rich.segment import Segment, Segments
from rich.style import Style
from rich.table import Table
from rich.text import Text
from rich.theme import Theme

from fieldkit.model.device import StreamInfo, regions_on
from fieldkit.model.durations import rounded_duration
from fieldkit.model.learnt import Learnt, LearntParameter
from fieldkit.model.samples import Event, Frame, Reading, Severity
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import CERTAIN, SlopeEstimate
from fieldkit.palettes import Colours, palette
from fieldkit.views import formatting, frame_image, learnt_words
from fieldkit.views.latest import Latest

THEMES: Mapping[str, Theme] = {
    "dark": Theme(
        {
            "base": "none",
            "quiet": "dim",
            "good": "green",
            "warning": "yellow",
            "alarm": "bold white on red",
            "bar.complete": "green",
        }
    ),
    # In sunlight only black on white can be read; nothing may depend on a shade of grey.
    "paper": Theme(
        {
            "base": "#000000 on #ffffff",
            "quiet": "#000000",
            "good": "#000000",
            "warning": "bold #000000",
            "alarm": "bold #ffffff on #900000",
            "bar.back": "#a0a0a0",
            "bar.complete": "#000000",
            "bar.finished": "#000000",
        }
    ),
}
"""Styles by theme: ``dark`` leaves the terminal's own colours, ``paper`` is black on white."""

INSTRUMENTS_WIDTH = 44
LOW_ROWS = 30
"""Height below which events and what was learnt have fewer lines."""
COMPACT_CELLS = 3
SNAPSHOT_EVENTS = 6
STOP_KEY = "Ctrl-C stops"
BRIGHTNESS_COLS = 30
"""Width of the image from which the scale has room for the word "brightness"."""
_FIRST_MINUTE = Text("first minute: brightness", "quiet")
NOISE_COLS, UNIT_COLS = 104, 112
"""Widths from which there is room for noise and given slope, and for the unit in the heading."""
_SEVERITY_STYLE = {Severity.INFO: "base", Severity.WARNING: "warning", Severity.ERROR: "alarm"}


def screen(latest: Latest, cols: int, rows: int) -> RenderableType:
    """The whole screen of `cols` by `rows` characters."""
    n_lines = min(len(latest.regions), max(1, rows - 18))
    is_low = rows < LOW_ROWS
    n_events = 3 if is_low else 6
    top_rows = max(1, rows - n_lines - n_events - 3)
    image, seen_cols = _image(latest, cols - INSTRUMENTS_WIDTH - 1, top_rows)
    top = Layout()
    top.split_row(Layout(image, size=seen_cols + 1), Layout(_instruments(latest, compact=is_low)))
    whole = Layout()
    whole.split_column(
        Layout(_title(latest), size=1),
        Layout(top, size=top_rows),
        Layout(regions_table(latest, cols, n_lines), size=n_lines + 1),
        Layout(_events(latest, n_events), size=n_events),
        Layout(_progress(latest), size=1),
    )
    return whole


def snapshot(latest: Latest, cols: int) -> RenderableType:
    """The same without image and progress, in as many lines as needed, for another terminal."""
    regions = regions_table(latest, cols, len(latest.regions))
    return Group(_instruments(latest), regions, _events(latest, SNAPSHOT_EVENTS))


# ---------------------------------------------------------------------- image


def half_blocks(rgb: Colours, labels: Mapping[tuple[int, int], str]) -> Segments:
    """An image in characters, two pixel rows in each line: ``▀`` has a colour above and one below."""
    packed = (rgb.astype(np.int64) @ np.array([65536, 256, 1])).tolist()
    segments: list[Segment] = []
    for row, (above, below) in enumerate(zip(packed[0::2], packed[1::2], strict=True)):
        for col, (top, bottom) in enumerate(zip(above, below, strict=True)):
            letter = labels.get((row, col))
            segments.append(Segment(letter, _LABEL) if letter else Segment("▀", _two_colours(top, bottom)))
        segments.append(Segment.line())
    return Segments(segments)


_LABEL = Style(color="#000000", bgcolor=Color.from_rgb(*frame_image.OUTLINE), bold=True)


@lru_cache(maxsize=8192)
def _two_colours(above: int, below: int) -> Style:
    return Style(color=Color.from_rgb(*above.to_bytes(3)), bgcolor=Color.from_rgb(*below.to_bytes(3)))


def _image(latest: Latest, max_cols: int, rows: int) -> tuple[RenderableType, int]:
    """The frame at its true proportions in at most `max_cols` by `rows`, and its width."""
    if (frame := latest.frame) is None:
        return Text("no frame yet", "quiet"), min(max(0, max_cols), 20)
    shape = frame.counts.shape
    lines = min(rows - 1, int(max_cols * shape[0] / shape[1] / 2))
    cols = min(max_cols, round(2 * lines * shape[1] / shape[0]))
    if lines < 1 or cols < 2:  # a narrow or flat terminal has no room for it
        return Text(), 0
    regions = regions_on(frame.stream, latest.regions, latest.streams.values())
    return _draw_frame(frame, latest.streams[frame.stream], regions, lines, cols), cols


def _draw_frame(
    frame: Frame, info: StreamInfo, regions: tuple[Region, ...], lines: int, cols: int
) -> RenderableType:
    """The frame in `lines` by `cols` with outlines and names, and the scale in one more line."""
    shape = frame.counts.shape
    values = frame_image.values(frame, info)
    scale = frame_image.scale_of(values, frame_image.unit(info))
    small = frame_image.resize(values, 2 * lines, cols)
    # 64 levels are more than the eye can distinguish here, and keep the styles in their cache.
    rgb = palette()[(np.rint(scale.position(small) * 63) * 4).astype(np.intp)]
    for region in regions:
        rgb[frame_image.outline_mask(region, shape, 2 * lines, cols)] = frame_image.OUTLINE
    return Group(half_blocks(rgb, _labels(regions, shape, lines, cols)), _scale(scale, cols))


def _labels(
    regions: tuple[Region, ...], shape: tuple[int, int], lines: int, cols: int
) -> dict[tuple[int, int], str]:
    """Letters of the regions' names, each name centred on the upper edge of its region."""
    cells = {}
    for region in regions:
        points = frame_image.on_grid(region, shape, lines, cols)
        row = int(np.clip(np.floor(points[:, 1].min() + 0.5), 0, lines - 1))
        middle = (points[:, 0].min() + points[:, 0].max() + 1) / 2
        start = int(np.clip(middle - len(region.name) / 2, 0, max(0, cols - len(region.name))))
        cells.update({(row, start + i): letter for i, letter in enumerate(region.name) if start + i < cols})
    return cells


def _scale(scale: frame_image.Scale, cols: int) -> Text:
    low, high = f"{scale.low:.0f} ", " " + scale.text(scale.high)
    if cols >= BRIGHTNESS_COLS and scale.unit == "°C":
        high += " brightness"
    width = max(1, cols - len(low) - len(high))
    bar = Text(low, "base")
    for index in np.linspace(0, 255, width).astype(int):
        bar.append(" ", Style(bgcolor=Color.from_rgb(*palette()[index].tolist())))
    return bar.append(high)


# ---------------------------------------------------------------------- instruments


def _title(latest: Latest) -> RenderableType:
    line = Table.grid(expand=True)
    line.add_column(no_wrap=True, ratio=1)
    line.add_column(no_wrap=True, justify="right")
    now = ""
    if latest.time_ns:
        date = formatting.local_time(latest.time_ns, latest.site).strftime("%Y-%m-%d %H:%M:%S")
        now = f"{date} {formatting.zone_name(latest.time_ns, latest.site)}"
    line.add_row(Text(f"fieldkit  {latest.title}", "bold"), Text(now, "bold"))
    return line


def _instruments(latest: Latest, *, compact: bool = False) -> RenderableType:
    lines = Table.grid(padding=(0, 1, 0, 0))
    lines.add_column(no_wrap=True)
    lines.add_column(overflow="fold")
    for name, text in _instrument_lines(latest, compact=compact):
        lines.add_row(Text(name, "quiet"), text if isinstance(text, Text) else Text(text))
    return lines


def _instrument_lines(latest: Latest, *, compact: bool) -> Iterator[tuple[str, str | Text]]:
    minute, health = latest.minute, latest.health
    for info, reading in latest.of_quantity("illuminance"):
        yield "light", f"{formatting.number(reading.values[0])} {info.unit}"
    if minute is not None:
        yield "irradiance", f"{formatting.number(minute.dni_w_m2)} W/m²  {minute.irradiance_model}"
        zenith, azimuth = (
            formatting.number(deg, 1) for deg in (minute.sun_zenith_deg, minute.sun_azimuth_deg)
        )
        yield "sun", f"zenith {zenith}°  azimuth {azimuth}°"
    for info, reading in latest.of_quantity("temperature"):
        yield "contact", _probes(info, reading) + " °C"
    for name in latest.streams:
        yield name, _stream_words(latest, name)
    yield "clock", _clock(latest)
    if health is not None:
        amount = f", {formatting.size(health.written_bytes)} written" if health.written_bytes else ""
        yield "disk", f"{formatting.size(health.disk_free_bytes)} free{amount}"
    if minute is not None and minute.learnt is not None:
        yield from _learnt_lines(minute.learnt, compact=compact)


def _learnt_lines(learnt: Learnt, *, compact: bool) -> Iterator[tuple[str, Text]]:
    """The main parameters as learnt so far, how much the data said of each, and what the residuals show."""
    parameters = learnt_words.main(learnt)
    if compact:
        for first in range(0, len(parameters), 2):
            yield "learnt", Text(" ".join(map(_learnt_briefly, parameters[first : first + 2])))
    else:
        for parameter in parameters:
            share = learnt_words.bar_and_percentage(learnt_words.from_data(parameter))
            yield (
                learnt_words.short(parameter),
                Text(f"{learnt_words.value_text(parameter):<19} ").append(share, "quiet"),
            )
    missed = learnt_words.correlations(learnt)
    words = ", ".join(f"{region} {value:.2f}" for region, value in missed.items())
    yield "residuals", Text(f"correlated: {words}", "warning") if missed else Text("uncorrelated", "good")


def _learnt_briefly(parameter: LearntParameter) -> str:
    name = learnt_words.SHORT.get(parameter.name, parameter.name)
    bar = learnt_words.bar(learnt_words.from_data(parameter), COMPACT_CELLS)
    return f"{name} {learnt_words.value(parameter)} {bar}"


def _probes(info: StreamInfo, reading: Reading) -> str:
    """Each probe's temperature behind its name: ``flat 26.9  b15 28.1``."""
    names = info.channels or ("",) * len(reading.values)
    in_celsius = (formatting.celsius(kelvin, 1) for kelvin in reading.values)
    return "  ".join(f"{name} {celsius}".lstrip() for name, celsius in zip(names, in_celsius, strict=True))


def _clock(latest: Latest) -> Text:
    """True if UTC was steady; the recorder reports every step and every suspend."""
    event = latest.clock_event
    if event is not None:
        return Text(f"{_at(event.time_ns, latest)} {event.text}", "warning")
    since = _at(latest.start_ns, latest)
    return Text(f"steady since {since}" if latest.start_ns else formatting.UNKNOWN)


def _stream_words(latest: Latest, name: str) -> Text:
    """Rate, number of samples, and the problems of a stream or the age of its last sample."""
    stream = latest.stream_health(name)
    if stream is None:
        return Text("waiting", "quiet")
    text = Text(f"{formatting.rate(latest.rate_hz(name)):>6} {formatting.number(stream.received):>7} ")
    troubles = latest.troubles(name).items()
    if counts := " ".join(f"{trouble} {count}" for trouble, count in troubles if count):
        return text.append(counts, "warning")
    age_s = latest.age_s(name)
    ago = f"{rounded_duration(age_s)} ago"
    return text.append(ago, "quiet") if age_s >= 3 else text.append("none lost", "good")


# ---------------------------------------------------------------------- regions


def regions_table(latest: Latest, cols: int, lines: int) -> RenderableType:
    """The regions in `lines` below a heading; if they do not fit, the last line counts the hidden ones.

    Temperatures are surface temperatures (°C), unlike those of the image; before the end of the first minute
    they are brightness temperatures.
    """
    wide = cols >= NOISE_COLS
    hidden = len(latest.regions) - lines
    visible_regions = latest.regions if hidden <= 0 else latest.regions[: max(1, lines - 1)]
    gap = 2 if wide else 1
    table = Table(box=None, padding=(0, gap, 0, 0), pad_edge=False, expand=True, header_style="quiet")
    table.add_column("region", no_wrap=True, max_width=12)
    sure = formatting.confidence(latest.minute.estimates if latest.minute else ())
    surface = "surface °C" if cols >= UNIT_COLS else "surface"
    for name in (surface, "spread", f"tilt ±{sure}", "azimuth ±", "K per °"):
        table.add_column(name, no_wrap=True, justify="right", min_width=len(name))
    if wide:
        table.add_column("noise", no_wrap=True)
        table.add_column("given", no_wrap=True)
    table.add_column("state", no_wrap=True, overflow="ellipsis", ratio=1)
    for region in visible_regions:
        estimate = _estimate(latest, region)
        *cells, state = _region_cells(latest, region, estimate)
        noise = formatting.noise(estimate) if estimate else ""
        more = [noise, formatting.given_slope(region)] if wide else []
        table.add_row(region.name, *cells, *more, state)
    if hidden <= 0:
        return table
    words = f"{len(latest.regions) - len(visible_regions)} more regions hidden: {hidden} more rows show them"
    return Group(table, Text(words, "warning"))


def _region_cells(latest: Latest, region: Region, estimate: SlopeEstimate | None) -> list[str | Text]:
    """Mean, spread, tilt, azimuth, kelvin per degree and state of one region."""
    minute = latest.minute
    if minute is None:
        return [*_as_seen(latest, region), *[formatting.UNKNOWN] * 3, _FIRST_MINUTE]
    mean, spread = (known.get(region.name, math.nan) for known in (minute.temperature_k, minute.spread_k))
    cells: list[str | Text] = [formatting.celsius(mean), formatting.number(spread, 2)]
    if region.kind is RegionKind.REFERENCE:
        azimuth = formatting.number(region.azimuth_deg) if region.tilt_deg else formatting.UNKNOWN
        return [*cells, formatting.number(region.tilt_deg, 1), azimuth, "", Text("reference", "quiet")]
    if estimate is None:
        return [*cells, *[formatting.UNKNOWN] * 4]
    return [
        *cells,
        formatting.tilt(estimate),
        formatting.azimuth(estimate),
        formatting.slope_number(estimate, "kelvin_per_degree"),
        Text(formatting.state(estimate), "good" if estimate.state in CERTAIN else "warning"),
    ]


def _estimate(latest: Latest, region: Region) -> SlopeEstimate | None:
    estimates = latest.minute.estimates if latest.minute else ()
    return next((estimate for estimate in estimates if estimate.region == region.name), None)


def _as_seen(latest: Latest, region: Region) -> list[str | Text]:
    """Mean and spread in the last frame, until the first minute has a surface temperature."""
    frame = latest.frame_of(region.camera)
    if frame is None or frame_image.unit(latest.streams[frame.stream]) != "°C":
        return [formatting.UNKNOWN, formatting.UNKNOWN]
    values = frame_image.values(frame, latest.streams[frame.stream])
    inside = values[region.mask((values.shape[0], values.shape[1]))]
    inside = inside[np.isfinite(inside)]
    mean, spread = (inside.mean(), inside.std()) if inside.size else (math.nan, math.nan)
    return [formatting.number(float(mean), 2), formatting.number(float(spread), 2)]


# ---------------------------------------------------------------------- events, progress


def _events(latest: Latest, count: int) -> RenderableType:
    """The present alarms in one line, if any, and the last events."""
    alarms = [_alarms(latest)] if latest.alarms else []
    last = latest.events[len(alarms) - count :]
    if not last:
        return Text("no events yet", "quiet")
    return Group(*alarms, *(_event(event, latest) for event in last))


def _alarms(latest: Latest) -> Text:
    """The oldest alarm of the highest severity, those not acknowledged first, and how many others."""
    worst = max(latest.alarms, key=lambda alarm: (not alarm.acknowledged, alarm.severity))
    others = len(latest.alarms) - 1
    since = _at(worst.since_ns, latest)
    text = f"ALARM since {since}: {worst.text}" + (f", and {others} more" if others else "")
    if worst.acknowledged:
        text += " (acknowledged)"
    return Text(text, _SEVERITY_STYLE.get(worst.severity, "warning"), no_wrap=True, overflow="ellipsis")


def _event(event: Event, latest: Latest) -> Text:
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(_at(event.time_ns, latest, seconds=True) + "  ", "quiet")
    return text.append(formatting.event_line(event), _SEVERITY_STYLE.get(event.severity, "warning"))


def _at(time_ns: int, latest: Latest, *, seconds: bool = False) -> str:
    """A time at the site, with its date if that is not today's."""
    now_ns = latest.time_ns or time_ns
    return formatting.clock_time(time_ns, latest.site, seconds=seconds, since_ns=now_ns)


def _progress(latest: Latest) -> RenderableType:
    done_s = (latest.time_ns - latest.start_ns) / 1e9
    lasted = rounded_duration(done_s)
    if latest.planned_end_ns is None:
        return Text(f"{lasted}, no planned end: {STOP_KEY}", "quiet")
    total_s = max(1.0, (latest.planned_end_ns - (latest.start_ns or latest.planned_end_ns)) / 1e9)
    ends = _at(latest.planned_end_ns, latest)
    line = Table.grid(expand=True, padding=(0, 1, 0, 0))
    line.add_column(ratio=1)
    line.add_column(no_wrap=True)
    line.add_row(
        ProgressBar(total=total_s, completed=min(done_s, total_s)),
        Text(f"{lasted} of {rounded_duration(total_s)}, ends {ends}, {STOP_KEY}"),
    )
    return line


def status_text(name: str, latest: Latest, start_ns: int, end_ns: int, warning: str, cols: int) -> str:
    """Which recording, since when, how long, the warning if there is one, then what is known now."""
    began = formatting.clock_time(start_ns, latest.site, since_ns=end_ns)
    last = formatting.clock_time(end_ns, latest.site, seconds=True)
    lines = [
        f"recording {name} since {began} {formatting.zone_name(start_ns, latest.site)}",
        f"  last sample {last}, {rounded_duration((end_ns - start_ns) / 1e9)} so far",
        *([f"warning: {warning}"] if warning else []),
    ]
    return "\n".join(lines) + "\n" + _draw(latest, cols)


def _draw(latest: Latest, cols: int) -> str:
    plain: Any = {"highlight": False, "emoji": False, "markup": False, "no_color": False}
    # the theme's colours are among the first sixteen, which every terminal has
    console = Console(file=io.StringIO(), width=cols, force_terminal=True, color_system="standard", **plain)
    with console.use_theme(THEMES["dark"]), console.capture() as capture:
        console.print(snapshot(latest, cols))
    return capture.get()
