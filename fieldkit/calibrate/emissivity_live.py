"""Record a session for an emissivity: it ends when the surface was steady at enough temperatures.

The session is recorded like any other, with a burst of frames a minute and a shutter correction before
each. The emissivity is found afterwards from the session alone.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldkit.calibrate import measurement
from fieldkit.calibrate.guidance import APART_K, advice_on_probe, advice_on_result
from fieldkit.calibration import steady_pairs
from fieldkit.calibration.emissivity import MIN_SPAN_K
from fieldkit.calibration.ranges import require_name
from fieldkit.config import Config, find_campaign, load_config
from fieldkit.estimation.estimator import Minute
from fieldkit.model.durations import as_seconds
from fieldkit.model.errors import CalibrationError
from fieldkit.model.samples import Event, EventKind, Frame, Reading
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.recorder.recorder import Shown
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.preflight import Notify
from fieldkit.recording.record import PreparedRecording, RecordedSession, prepare
from fieldkit.results.sources import Settings, log_warning, settings_from

BURSTS = (
    "record.sampling=bursts",
    "record.every_s=60.0",
    "record.burst_frames=25",
    "record.shutter_before_burst=true",
)
"""Settings that a recording for an emissivity has unless others are given."""
PROGRESS_NS = 600_000_000_000
"""How often session and field page have an event of the progress, if nothing changed before."""
RECENT_NS = 120_000_000_000
"""Length of the interval of the drift that is shown."""


def record_emissivity(
    campaign: str | Path = ".",
    *,
    sample: str,
    options: measurement.MeasurementOptions | None = None,
    settings: Settings = (),
    on_minute: Callable[[str], None] = lambda line: None,
    notify: Notify = log_warning,
) -> RecordedSession:
    """Record a campaign's instruments until the surface was steady at enough temperatures.

    Foil and probe must be in place; `prepare_emissivity` allows to wait for that.

    Parameters
    ----------
    campaign : path
        Folder of the campaign, or one inside it.
    sample : str
        What is measured; goes into the session's name.
    options : MeasurementOptions, optional
        What is measured with what, and after how many temperatures or how long to stop.
    settings : mapping, or sequence of ``KEY=VALUE``
        Other values for keys of the configuration, such as ``record.burst_frames=3``.
    on_minute : callable
        Receives a line each minute: how steady the surface is, and how many temperatures there are.
    notify : callable
        Receives warnings of the preflight.

    Raises
    ------
    ConfigError, DeviceError, RefusedError, StorageError
        See `fieldkit.recording.record.record`.

    Examples
    --------
    >>> options = fieldkit.calibrate.MeasurementOptions(reflected="b05", temperatures=1, duration="10m")
    >>> recorded = fieldkit.calibrate.record_emissivity(
    ...     "sandslope", sample="sand", options=options, settings={"simulation.speed": "max"}
    ... )
    >>> recorded.path.name
    '20160101T190001Z-sand.h5'
    """
    config = load_config(find_campaign(Path(campaign)), settings=(*BURSTS, *settings_from(settings)))
    stopping = threading.Event()
    with prepare_emissivity(config, sample, options or measurement.MeasurementOptions(), notify) as prepared:
        view = prepared.view(on_minute, stopping.set)
        recording = prepared.recording.run([view], stopping=stopping)
    recording.raise_failure()
    return recording


@dataclass(frozen=True, slots=True)
class PreparedMeasurement:
    """A recording for an emissivity that can start: instruments open and checked."""

    recording: PreparedRecording
    setup: measurement.MeasurementSetup

    @property
    def steps(self) -> str:
        """Steps before and during the recording, one step a line."""
        setup = self.setup
        reflected = "reflected temperature given"
        if setup.foil is not None:
            reflected = f"foil in region {setup.foil.name}, in the sample's plane"
        contact = f"probe {setup.probe_name} under one layer of grains in region {setup.sample.name}"
        if setup.tape is not None:
            contact = f"tape in region {setup.tape.name}"
        return f"1  {reflected}\n2  {contact}\n3  wait until each temperature is steady; Ctrl-C when done"

    def view(self, on_minute: Callable[[str], None], stop: Callable[[], None]) -> SteadyView:
        """A view of the recording that reports every minute, and calls `stop` when there is enough."""
        collector, config = measurement.ReadingCollector(self.setup), self.recording.config
        return SteadyView(collector, config, on_minute, self._report, stop)

    def _report(self, text: str, progress: Mapping[str, Any]) -> None:
        """Pass an event to the recording: session and field page show it."""
        clock = self.recording.instruments.clock
        now_ns = clock.mono_ns()
        event = Event(EventKind.ESTIMATOR, now_ns, clock.to_utc_ns(now_ns), text, data=progress)
        self.recording.triggers.add(event)


@contextmanager
def prepare_emissivity(
    config: Config, sample: str, options: measurement.MeasurementOptions, notify: Notify = log_warning
) -> Iterator[PreparedMeasurement]:
    """Open a campaign's instruments and choose streams and regions; see `record_emissivity`."""
    require_name(sample)
    foil, _ = measurement.reflected_source(options.reflected, config.regions, config.path)
    if foil is not None:  # it is no bed: the recording gives it no slope
        config = config.with_kind(foil.name, "foil")
    duration_s = None if options.duration is None else as_seconds(options.duration)
    with prepare(config, RecordOptions(name=sample, duration_s=duration_s), notify) as recording:
        probes = config.estimator_settings().probes
        streams = recording.instruments.streams
        setup = measurement.measurement_setup(config.path, streams, config.regions, probes, options)
        yield PreparedMeasurement(recording, setup)


@dataclass
class SteadyView:
    """A view of the recording that guides the measurement minute by minute, and ends it when done.

    `on_progress` receives the guidance whenever a temperature is new or the emissivity becomes good enough,
    and every ten minutes.
    """

    collector: measurement.ReadingCollector
    config: Config
    on_minute: Callable[[str], None]
    on_progress: Callable[[str, Mapping[str, Any]], None]
    stop: Callable[[], None]
    _stage: tuple[object, ...] = ()

    def show(self, item: Shown) -> None:
        """See `fieldkit.recorder.View`."""
        if isinstance(item, Frame | Reading):
            self.collector.add(item)
        elif isinstance(item, Minute):
            self._inspect(item)

    def close(self) -> None:
        """See `fieldkit.recorder.View`; nothing to release."""

    def _inspect(self, minute: Minute) -> None:
        setup = self.collector.setup
        try:
            readings = self.collector.readings()
        except CalibrationError as error:
            self.on_minute(f"   {error.message}" + (f"; {error.fix}" if error.fix else ""))
            return
        intervals, wanted = steady_pairs.steady_intervals(readings), setup.options.temperatures
        levels_k = apart(steady_k := [interval.contact_k for interval in intervals])
        count, span_k = len(levels_k), max(steady_k, default=0.0) - min(steady_k, default=0.0)
        progress = f"temperatures {count} of {wanted}, span {span_k:.0f} K"
        advice = list(advice_on_probe(readings, levels_k, self.config.estimator_settings()))
        with suppress(CalibrationError):  # as long as the intervals do not determine it
            fit = setup.fit(steady_pairs.pairs_of(intervals)[0])
            beds = [bed for bed in self.config.regions if bed != setup.tape]
            advice.append(advice_on_result(fit, minute, beds, self.config))
        lines = [line for line, _ in advice]
        self.on_minute("\n".join(f"   {line}" for line in (f"{_state(readings)}   {progress}", *lines)))
        values: dict[str, Any] = {"temperatures": count, "wanted": wanted}
        for _, part in advice:  # the page takes its words from the last name that it has words for
            values |= part
        stage = count, values.get("enough"), minute.time_ns // PROGRESS_NS
        if stage != self._stage:
            self._stage = stage
            self.on_progress("; ".join((progress, *lines)), values)
        if count >= wanted and span_k >= (MIN_SPAN_K if setup.is_reflected_fitted else 0.0):
            self.stop()


def _state(readings: steady_pairs.Readings) -> str:
    recent = readings.contact_ns > int(readings.contact_ns[-1]) - RECENT_NS
    drift = steady_pairs.drift_k_min(readings.contact_ns[recent], readings.contact_k[recent])
    probe, apparent, reflected = (
        "fitted" if kelvin == measurement.NOT_MEASURED_K else f"{kelvin - CELSIUS_ZERO_K:5.1f} °C"
        for kelvin in (readings.contact_k[-1], readings.apparent_k[-1], readings.reflected_k[-1])
    )
    state = "steady" if abs(drift) < steady_pairs.STEADY_K_MIN else "wait"
    return f"probe {probe}  {drift:+.2f} K/min {state:6}   apparent {apparent}   reflected {reflected}"


def apart(steady_k: Sequence[float]) -> list[float]:
    """Those of the steady temperatures that are at least 5 K apart, in order of time."""
    levels_k: list[float] = []
    for temperature_k in steady_k:
        if all(abs(temperature_k - other) >= APART_K for other in levels_k):
            levels_k.append(temperature_k)
    return levels_k
