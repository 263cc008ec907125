"""Parts of an emissivity measurement, and its samples as readings in kelvin.

Used alike for a recorded session and for instruments that are being read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from fieldkit.calibrate.inputs import one_region
from fieldkit.calibration import band as bands
from fieldkit.calibration.emissivity import (
    Emissivity,
    Pairs,
    SharedUncertainties,
    fit_emissivity,
    is_saturated,
    mirrored_temperature_k,
    refuse_saturated,
)
from fieldkit.calibration.foil import FOIL_EMISSIVITY, FOIL_EMISSIVITY_SD
from fieldkit.calibration.ranges import TEMPERATURE_C, require_ranges
from fieldkit.calibration.steady_pairs import Readings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.device import StreamInfo, find_camera
from fieldkit.model.door import checked
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.limits import bounds_by_name
from fieldkit.model.next_step import Action, Argument
from fieldkit.model.quantities import kelvin_if_fahrenheit
from fieldkit.model.samples import Frame, Sample, is_usable
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.physics.camera_laws import frame_k

FITTED = "free"
"""Value of `reflected` that leaves the reflected temperature to the fit."""
NOT_MEASURED_K = 150.0
"""Stands in for a reflected temperature that is left to the fit: colder than any sky."""

_Unit = Literal["C", "F"]


@checked
@dataclass(frozen=True, slots=True)
class MeasurementOptions:
    """Method of an emissivity measurement, and the uncertainty of each part.

    Parameters
    ----------
    region : str, optional
        Region of the sample; the reference region by default.
    thermometer : str, optional
        Stream of the contact thermometer; needed if the session has several and no `probes` of the region.
    channel : str or int, optional
        Probe of the thermometer, by name or by number from 1; the region's own by default, or else the first.
    reflected : str or float
        Region of a foil that shows the reflected temperature, that temperature in °C, or ``free`` to fit it.
        By default the region whose kind is foil, or else the one of that name.
    tape : str, optional
        Region of a tape or paint of known emissivity, used instead of a thermometer.
    tape_emissivity, tape_sd : float
        Emissivity of the tape and its standard uncertainty.
    foil_emissivity, foil_sd : float
        Emissivity of the foil itself and its standard uncertainty.
    band : str
        Spectral band of the camera: ``8-14`` (flat, micrometres), the file of a spectral response,
        or the camera's constants ``B,F`` or ``R,B,F,O``.
    camera_emissivity : float, optional
        Emissivity already applied by the camera.
    camera_reflected_c : float
        Reflected temperature already applied by the camera. [°C]
    distance_m, air_c, humidity_percent : float
        Path through the air; only lengths above a few metres matter. [m, °C, %]
    angle_deg : float, optional
        Viewing angle from the surface normal. [degrees]
    unit : {"C", "F"}
        Unit the thermometer displayed; ``F`` if it was recorded as °C by mistake.
    camera_sd_k, thermometer_sd_k, probe_sd_k, reflected_sd_k : float
        Standard uncertainties of camera, thermometer, contact between probe and surface, and
        reflected temperature. [K]
    probe_gradient_sd_k, sky_drift_sd_k : float
        Half of the change between the coldest and the warmest pair: of the probe's error, and of the
        reflected temperature where no foil measures it. [K]
    temperatures : int
        While recording: stop after this many steady temperatures.
    duration : str or float, optional
        While recording: stop after this time, such as ``3h``.

    Raises
    ------
    ConfigError
        For a number beyond its range in `fieldkit.calibration.ranges`, or another unit.

    Examples
    --------
    >>> options = fieldkit.calibrate.MeasurementOptions(region="flat", reflected=-42.0, probe_sd_k=0.2)
    >>> options.as_settings()["reflected"]
    '-42.0'
    """

    region: str | None = None
    thermometer: str | None = None
    channel: str | int | None = None
    reflected: str | float = "foil"
    tape: str | None = None
    tape_emissivity: float = 0.95
    tape_sd: float = 0.01
    foil_emissivity: float = FOIL_EMISSIVITY
    foil_sd: float = FOIL_EMISSIVITY_SD
    band: str = "8-14"
    camera_emissivity: float | None = None
    camera_reflected_c: float = 20.0
    distance_m: float = 0.0
    air_c: float = 20.0
    humidity_percent: float = 50.0
    angle_deg: float | None = None
    unit: _Unit = "C"
    camera_sd_k: float = 0.3
    thermometer_sd_k: float = 0.3
    probe_sd_k: float = 0.5
    reflected_sd_k: float = 5.0
    probe_gradient_sd_k: float = 0.25
    sky_drift_sd_k: float = 3.0
    temperatures: int = 3
    duration: str | float | None = None

    def __post_init__(self) -> None:
        require_ranges(asdict(self))
        if self.unit not in get_args(_Unit):
            raise ConfigError(
                "not a unit of a thermometer", place=Argument("unit", self.unit), fix="give C or F"
            )

    def as_settings(self) -> dict[str, Any]:
        """The options by their names in a calibration record, to repeat it; empty ones are omitted."""
        options = {**asdict(self), "reflected": str(self.reflected)}
        return {key: value for key, value in options.items() if value not in (None, "", False)}


@dataclass(frozen=True, slots=True)
class MeasurementSetup:
    """Streams and regions of a measurement, and what lies between surface and camera.

    `foil` is None if the reflected temperature is not measured by the camera. `tape` is the region used
    instead of a thermometer. `camera_emissivity` was already applied by the camera. `probe_is_in` is another
    region in which the configuration has the chosen probe.
    """

    options: MeasurementOptions
    camera: StreamInfo
    sample: Region
    band: bands.Band
    foil: Region | None
    tape: Region | None
    reflected_k: float
    camera_emissivity: float
    thermometer: StreamInfo | None = None
    channel: int = 0
    probe_is_in: str = ""

    @property
    def remarks(self) -> tuple[str, ...]:
        """A note if the configuration has the chosen probe in another region."""
        if not self.probe_is_in:
            return ()
        return (
            f"the probe {self.probe_name} is in {self.probe_is_in}, not in {self.sample.name}, by its probes",
        )

    @property
    def is_reflected_fitted(self) -> bool:
        """True if the reflected temperature is left to the fit."""
        return self.options.reflected == FITTED

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Probes of the thermometer, by name or else by number from 1."""
        return () if self.thermometer is None else self.thermometer.channel_names

    @property
    def probe_name(self) -> str:
        """Name of the chosen probe; empty without a thermometer."""
        return self.channel_names[self.channel] if self.thermometer is not None else ""

    def fit(self, pairs: Pairs) -> Emissivity:
        """The emissivity by these pairs, the uncertainties as in the options; raises `CalibrationError`."""
        options = self.options
        sds = options.camera_sd_k, options.thermometer_sd_k, options.probe_sd_k, options.reflected_sd_k
        drifts = {"sky_drift_k": options.sky_drift_sd_k, "probe_gradient_k": options.probe_gradient_sd_k}
        return fit_emissivity(
            pairs,
            SharedUncertainties(*sds, **drifts),
            reflected="free" if self.is_reflected_fitted else "fixed",
            band=self.band,
            tape_emissivity=options.tape_emissivity,
            tape_emissivity_sd=options.tape_sd if self.tape is not None else 0.0,
            foil_emissivity_sd=options.foil_sd if self.foil is not None else 0.0,
        )


def measurement_setup(
    where: Path,
    streams: Sequence[StreamInfo],
    regions: Sequence[Region],
    probes: Mapping[str, Sequence[str]],
    options: MeasurementOptions,
) -> MeasurementSetup:
    """Choose the streams and regions of a measurement from those of a session or campaign at `where`.

    `probes` are those configured in regions, as ``stream:channel``. Raises `ConfigError` if a choice is
    unclear.
    """
    camera = find_camera(streams)
    if camera is None:
        raise ConfigError("no camera", place=where, fix="name a session with frames of a camera")
    reference = next((region.name for region in regions if region.kind is RegionKind.REFERENCE), "")
    foil, reflected_k = reflected_source(options.reflected, regions, where)
    setup = MeasurementSetup(
        options,
        camera,
        one_region(regions, options.region or reference, where),
        band_of(options.band),
        foil,
        one_region(regions, options.tape, where) if options.tape else None,
        reflected_k,
        _applied_emissivity(camera, options.camera_emissivity),
    )
    _require_different_regions(setup)
    return setup if setup.tape is not None else _with_thermometer(setup, where, streams, probes)


def _require_different_regions(setup: MeasurementSetup) -> None:
    """Raise `ConfigError` if a region is two of sample, foil and tape, and so compared with itself."""
    names = [region.name for region in (setup.sample, setup.foil, setup.tape) if region is not None]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(
                "a region cannot be two of sample, foil and tape",
                place=name,
                fix="draw one region on each, and name them",
            )


def _with_thermometer(
    setup: MeasurementSetup,
    where: Path,
    streams: Sequence[StreamInfo],
    probes: Mapping[str, Sequence[str]],
) -> MeasurementSetup:
    options, region = setup.options, setup.sample.name
    thermometers = [info for info in streams if info.quantity == "temperature"]
    chosen = [info for info in thermometers if options.thermometer in (None, info.name)]
    placed = list(_placed(probes, chosen))
    if options.channel is None:
        for name, info, channel in placed:
            if name == region:
                return replace(setup, thermometer=info, channel=channel)
    if len(chosen) != 1:
        have = ", ".join(info.name for info in thermometers) or "none"
        raise ConfigError("which thermometer?", place=where, fix=Argument("thermometer") + f": {have}")
    (info,) = chosen
    channel = _channel(info, options.channel)
    elsewhere = next((name for name, _, number in placed if name != region and number == channel), "")
    if elsewhere and options.channel is None:
        first = f"{info.name}:{info.channel_names[channel]}"
        raise ConfigError(
            f"no probe is in it; {first} is in {elsewhere}",
            place=region,
            fix=f"give the one in {region} as " + Argument("channel") + ", or that region its probes",
        )
    return replace(setup, thermometer=info, channel=channel, probe_is_in=elsewhere)


def _placed(
    probes: Mapping[str, Sequence[str]], streams: Sequence[StreamInfo]
) -> Iterator[tuple[str, StreamInfo, int]]:
    """Region, stream and channel of each configured probe of these streams."""
    for region, texts in probes.items():
        for stream, _, text in (text.partition(":") for text in texts):
            for info in streams:
                if info.name == stream and (channel := info.channel(text)) is not None:
                    yield region, info, channel


def _applied_emissivity(camera: StreamInfo, given: float | None) -> float:
    """The emissivity already applied by the camera: from its stream, or as given."""
    reported = float(camera.settings.get("emissivity", 1.0))
    if given is not None and reported not in (1.0, given):
        raise ConfigError(
            f"the camera reports that it applied {reported:g}",
            place=Argument("camera_emissivity", given),
            fix="omit " + Argument("camera_emissivity") + ": an emissivity must not be corrected for twice",
        )
    return reported if given is None else given


def reflected_source(
    reflected: str | float, regions: Sequence[Region], where: Path
) -> tuple[Region | None, float]:
    """The foil's region or the reflected temperature in kelvin."""
    if reflected == FITTED:
        return None, NOT_MEASURED_K
    if reflected == "foil":
        reflected = next((region.name for region in regions if region.kind is RegionKind.FOIL), reflected)
    try:
        celsius = float(reflected)
    except ValueError:
        return one_region(regions, str(reflected), where), math.nan
    if celsius not in TEMPERATURE_C:
        raise ConfigError(
            "not a reflected temperature",
            place=Argument("reflected", reflected),
            fix=f"give one in °C {TEMPERATURE_C.words}, a foil's region, or free",
        )
    return None, celsius + CELSIUS_ZERO_K


def _channel(thermometer: StreamInfo, text: str | int | None) -> int:
    channel = 0 if text is None else thermometer.channel(str(text))
    if channel is None:
        have = ", ".join(thermometer.channel_names)
        raise ConfigError(f"no probe {text!r}", place=thermometer.name, fix=f"name one of these: {have}")
    return channel


def band_of(text: str) -> bands.Band:
    """A band from ``8-14``, a file of wavelength and response, ``B,F`` or ``R,B,F,O``."""
    if text == "8-14":
        return bands.FLAT
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        return bands.ResponseBand.read(Path(text))
    band = None
    if len(numbers) == 2:
        band = bands.CameraBand(*numbers)
    if len(numbers) == 4:
        band = bands.CameraBand(numbers[1], numbers[2], numbers[0], numbers[3])
    if band is not None and all(map(math.isfinite, numbers)) and band.b > 0.0 and band.r > 0.0:
        return band
    raise ConfigError(
        "not a valid band", place=Argument("band", text), fix="use 8-14, a file, B,F or R,B,F,O"
    )


@dataclass
class ReadingCollector:
    """Collects what an emissivity needs of each sample; `add` is quick, `readings` does the work."""

    setup: MeasurementSetup
    _camera: list[tuple[int, float, float, float]] = field(default_factory=list)
    _probes: list[tuple[int, tuple[float, ...]]] = field(default_factory=list)
    _saturated: int = 0
    _lowest_k: float = math.inf

    def __post_init__(self) -> None:
        rows, cols = self.setup.camera.shape
        regions = (self.setup.sample, self.setup.foil, self.setup.tape)
        self._masks = [None if region is None else region.mask((rows, cols)) for region in regions]

    def add(self, sample: Sample) -> None:
        """Add a sample of any stream; unusable samples are skipped."""
        if not is_usable(sample.quality):
            return
        probe = self.setup.thermometer
        if isinstance(sample, Frame):
            if sample.stream == self.setup.camera.name:
                self._add_frame(sample)
        elif probe is not None and sample.stream == probe.name:
            self._probes.append((sample.time_ns, sample.values))

    def _add_frame(self, frame: Frame) -> None:
        info = self.setup.camera
        kelvin = frame_k(info, frame.counts, frame.metadata_rows)
        means = [float("nan") if mask is None else float(kelvin[mask].mean()) for mask in self._masks]
        self._camera.append((frame.time_ns, *means))  # type: ignore[arg-type]
        foil = self._masks[1]
        if foil is not None and is_saturated(frame.counts[foil]):
            self._saturated += 1
            self._lowest_k = min(self._lowest_k, float(kelvin[foil].min()))

    def readings(self) -> Readings:
        """Camera and thermometer in kelvin, corrected for the camera's own settings and the air.

        Raises `CalibrationError` for a saturated foil, or without usable frames or probe readings.
        """
        setup = self.setup
        refuse_saturated(len(self._camera), self._saturated, self._lowest_k)
        if not self._camera or (setup.thermometer is not None and not self._probes):
            raise CalibrationError(
                f"no usable {'frames' if not self._camera else 'thermometer readings'}",
                fix=Action.CHECK() + " shows why samples are flagged",
            )
        times = np.array([row[0] for row in self._camera], np.int64)
        table = np.array([row[1:] for row in self._camera], np.float64).T
        apparent, foil, tape = (self._at_surface(column) for column in table)
        # the foil lies on the surface, so it has about its temperature and emits a few per cent itself
        reflected = (
            np.full(times.size, setup.reflected_k)
            if setup.foil is None
            else mirrored_temperature_k(foil, apparent, setup.options.foil_emissivity, setup.band)
        )
        if setup.tape is not None:
            contact = bands.own_part_k(tape, setup.options.tape_emissivity, reflected, setup.band)
            return Readings(times, apparent, reflected, times, contact)
        probe_ns = np.array([time_ns for time_ns, _ in self._probes], np.int64)
        return Readings(times, apparent, reflected, probe_ns, self.probes_k()[:, setup.channel])

    def probes_k(self) -> FloatArray:
        """All probes, (m, channels), kelvin; NaN where they show what cannot be."""
        values = np.array([row for _, row in self._probes], np.float64)
        probe = self.setup.thermometer
        assert probe is not None
        kelvin = kelvin_if_fahrenheit(values) if self.setup.options.unit == "F" else values
        return np.where(
            bounds_by_name(["probe_temperature"], probe.limits).is_exceeded(kelvin), np.nan, kelvin
        )

    def other_probes_k(self) -> dict[str, FloatArray]:
        """The probes that were not chosen, by name; probes without any reading are omitted."""
        setup = self.setup
        if setup.thermometer is None:
            return {}
        probes = self.probes_k()
        return {
            name: probes[:, number]
            for number, name in enumerate(setup.channel_names)
            if number != setup.channel and np.isfinite(probes[:, number]).any()
        }

    def _at_surface(self, seen_k: FloatArray) -> FloatArray:
        """Brightness temperature at the surface, before air and camera settings changed it, kelvin."""
        setup, options, surface_k = self.setup, self.setup.options, np.array(seen_k)
        if setup.camera_emissivity != 1.0:
            reflected_k = options.camera_reflected_c + CELSIUS_ZERO_K
            surface_k = bands.before_camera_settings(
                surface_k, setup.camera_emissivity, reflected_k, setup.band
            )
        if options.distance_m > 0.0:
            air_k = options.air_c + CELSIUS_ZERO_K
            through = bands.transmission(options.distance_m, air_k, options.humidity_percent / 100.0)
            surface_k = bands.own_part_k(surface_k, through, air_k, setup.band)
        return surface_k
