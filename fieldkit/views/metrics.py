"""A recording's present state as OpenMetrics text, for Prometheus and what reads its format.

Format: https://prometheus.io/docs/specs/om/open_metrics_spec. A node exporter reads the same text from a file
of its textfile collector. Names end in their unit; channels of meters have theirs as a label.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path

from fieldkit.disk import replacing
from fieldkit.model.channels import quantity_of
from fieldkit.model.samples import Reading, Severity, is_usable
from fieldkit.model.units import CELSIUS_ZERO_K, SECOND_NS
from fieldkit.model.version import __version__
from fieldkit.views.latest import Item, Latest

log: logging.Logger = logging.getLogger(__name__)

MEDIA_TYPE = "application/openmetrics-text; version=1.0.0; charset=utf-8"
FILE_EVERY_S = 5.0
"""Time between two versions of the file; a node exporter looks every 15 s."""
Family = tuple[str, str, Mapping[tuple[str, ...], float]]
"""Name and meaning of a metric, and its values by their labels, each written ``name=text``."""


def metrics(latest: Latest, *, is_recording: bool) -> str:
    """The state of a recording, or of a preview, as OpenMetrics text."""
    about = (f"session={latest.title if is_recording else ''}", f"version={__version__}")
    families: list[Family] = [
        ("recording", "1 while a session is recorded", {(): is_recording}),
        ("build_info", "The session and the version of the program", {about: 1}),
        ("clock_steady", "1 while the clock was not stepped", {(): latest.clock_event is None}),
        *_health(latest),
        *_streams(latest),
        *_regions(latest),
        *_alarms(latest),
    ]
    return "".join(line + "\n" for family in families for line in _lines(*family)) + "# EOF\n"


def _lines(name: str, meaning: str, values: Mapping[tuple[str, ...], float]) -> Iterator[str]:
    """A metric as text: what its name ends in gives its kind."""
    family, _, ending = name.rpartition("_")
    kind = {"total": "counter", "info": "info"}.get(ending, "gauge")
    yield f"# TYPE fieldkit_{name if kind == 'gauge' else family} {kind}"
    yield f"# HELP fieldkit_{name if kind == 'gauge' else family} {meaning}."
    for labels, value in values.items():
        pairs = ",".join(
            f'{key}="{text}"' for key, _, text in (_escaped(label).partition("=") for label in labels)
        )
        yield f"fieldkit_{name}{{{pairs}}} {float(value) if math.isfinite(value) else 'NaN'}"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


def _by(label: str, values: Mapping[str, float]) -> Mapping[tuple[str, ...], float]:
    return {(f"{label}={name}",): value for name, value in values.items()}


def _health(latest: Latest) -> Iterator[Family]:
    if (health := latest.health) is not None:
        yield "last_second_timestamp_seconds", "The second this is of", {(): health.time_ns / SECOND_NS}
        yield "disk_free_bytes", "Free space for recordings", {(): health.disk_free_bytes}
        yield "written_bytes_total", "Bytes written to the session", {(): health.written_bytes}
        yield "lag_seconds", "Longest way of a sample to the recorder", {(): health.lag_ms / 1e3}
        yield "cpu_ratio", "Load of the recorder, 1 is one core", {(): health.cpu_percent / 100.0}


def _streams(latest: Latest) -> Iterator[Family]:
    streams = {stream.stream: stream.received for stream in (latest.health.streams if latest.health else ())}
    yield "samples_total", "Samples received", _by("stream", streams)
    for trouble in ("lost", "garbled", "implausible", "gaps"):
        counts = {name: latest.troubles(name)[trouble] for name in streams}
        yield f"samples_{trouble}_total", f"Samples of a stream: {trouble}", _by("stream", counts)
    rates, ages = ({name: number(name) for name in streams} for number in (latest.rate_hz, latest.age_s))
    yield "sample_rate_hertz", "Samples a second, over the last minute", _by("stream", rates)
    yield "sample_age_seconds", "Age of the last sample", _by("stream", ages)
    channels = {
        labels: value for reading in latest.readings.values() for labels, value in _channels(latest, reading)
    }
    yield "channel_value", "Last value of a meter's channel, in its unit", channels


def _channels(latest: Latest, reading: Reading) -> Iterator[tuple[tuple[str, ...], float]]:
    info = latest.streams[reading.stream]
    shown = quantity_of(info).shown
    for name, value in zip(info.channel_names, reading.values, strict=False):
        labels = (f"stream={info.name}", f"channel={name}", f"unit={shown.shown}")
        yield labels, shown.shown_value(value) if is_usable(reading.quality) else math.nan


def _regions(latest: Latest) -> Iterator[Family]:
    if (minute := latest.minute) is not None:
        yield "direct_irradiance_w_m2", "Direct normal irradiance", {(): minute.dni_w_m2}
        celsius = {name: kelvin - CELSIUS_ZERO_K for name, kelvin in minute.temperature_k.items()}
        yield "region_temperature_celsius", "Surface of a region", _by("region", celsius)
        for angle in ("tilt", "tilt_low", "tilt_high", "azimuth"):
            angles = {slope.region: getattr(slope, f"{angle}_deg") for slope in minute.estimates}
            yield f"region_{angle}_degrees", "Slope, and ends of its likelihood region", _by("region", angles)


def _alarms(latest: Latest) -> Iterator[Family]:
    present = {alarm.id: not alarm.acknowledged for alarm in latest.alarms}
    yield "alarm", "An alarm that is present, 0 once it is acknowledged", _by("alarm", present)
    raised = {severity.name.lower(): latest.raised.get(severity, 0) for severity in Severity}
    yield "alarms_raised_total", "Alarms since the start", _by("severity", raised)


class MetricsFile:
    """A view that keeps a file of a recording's metrics, replaced as a whole by a thread of its own.

    A folder that hangs or cannot be written costs the file alone.
    """

    def __init__(self, path: Path, latest: Latest) -> None:
        self._path, self._latest, self._is_over = path, latest, threading.Event()
        self._thread = threading.Thread(target=self._run, name="metrics", daemon=True)
        self._thread.start()

    def show(self, item: Item) -> None:
        """Keep what the next version of the file will have."""
        self._latest.update(item)

    def close(self) -> None:
        """Write that nothing is recorded any more, for at most a second."""
        self._is_over.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        is_over = False
        while not is_over:
            is_over = self._is_over.wait(FILE_EVERY_S)
            try:
                with replacing(self._path, synced=False) as draft:
                    draft.write_text(metrics(self._latest, is_recording=not is_over), encoding="utf-8")
            except OSError as error:
                log.warning("the metrics cannot be written: %s", error)
