"""Choice of the stream for each quantity, and means of a minute's readings: irradiances, air, probes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldkit.estimation.bins import OpenBin
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.channels import AIR_TEMPERATURE, air_quantities, how_to_state, radiation_components
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.limits import Bounds, bounds_of
from fieldkit.model.quantities import POWER
from fieldkit.model.samples import Quality, Reading
from fieldkit.model.site import Region, Site
from fieldkit.physics.facet import VERTICAL, normal
from fieldkit.physics.irradiance import IrradianceModel, direct_normal
from fieldkit.physics.sun import sun_vectors

SUNLIGHT = ("dni", "ghi", "gti", "illuminance")
"""Components that DNI can be derived from, best first: the fewer assumptions the better."""
SLOW_HZ = 1.0 / 120.0  # slower streams have no value in some minutes: theirs are means that stand for a while
OVERDUE = 1.5
"""Number of its own intervals after which a mean of more than a minute has expired."""
LEAST_READINGS = 6
"""In a minute: with fewer, a cloud may pass between one reading and the next."""
FACTOR = 8.0
"""Distance from the neighbours, over that of these and of other readings from each other."""

LEAST_K, LEAST_SHARE = 1.0, 0.05
"""Deviation that is always kept: less in one reading of a minute cannot move a slope by 0.1 degrees."""


@dataclass(frozen=True, slots=True)
class MinuteIrradiance:
    """Light readings of one minute in order of time, and the irradiances they give.

    `dni_w_m2` and `clearness` (reading relative to its clear-sky expectation) are per reading, (k,);
    `clearness` is NaN while the sun is low. `dhi_w_m2` is the measured diffuse light, NaN without.
    """

    readings: list[Reading]
    dni_w_m2: FloatArray
    clearness: FloatArray
    illuminance_lx: float
    dhi_w_m2: float
    flags: Quality


@dataclass(frozen=True, slots=True)
class Source:
    """One channel of a stream, what it measures, and the limits of the stream's channels.

    That is a component of radiation, ``illuminance``, ``air_temperature``, ``wind_speed``, or ``temperature``
    of a contact thermometer.
    """

    info: StreamInfo
    channel: int
    measures: str
    bounds: Bounds

    @property
    def is_slow(self) -> bool:
        """True if most minutes have no reading of it, as of hourly means."""
        return 0.0 < self.info.rate_hz < SLOW_HZ

    def values(self, minute: OpenBin, sine: FloatArray | float | None = None) -> FloatArray:
        """The readings of a bin in order of time (k,), NaN where one is not usable or cannot be.

        `sine` is of the sun's elevation, (k,) at each reading or one for all.
        """
        if not (readings := minute.sorted_readings(self.info.name)):
            return np.empty(0)
        table = np.array([reading.values for reading in readings], np.float64)
        flags = np.array([int(reading.quality) for reading in readings], np.int64)
        values = self.bounds.usable(table, flags, sine)[:, self.channel]
        return without_spikes(values, is_temperature=self.info.unit == "K")


class Instruments:
    """The stream used for each quantity.

    `model` is the irradiance model of the stream that DNI is derived from (`light_source`), not necessarily
    the light meter's; `label` describes it in words. `unknown` are streams that may measure sunlight, but do
    not declare what they measure; `absent` are the streams of configured probes that are not there. Raises
    `ConfigError` if for that reason there is no sunlight, or if the configuration contradicts the streams.
    """

    def __init__(self, streams: Sequence[StreamInfo], settings: EstimatorSettings) -> None:
        self._streams = {info.name: info for info in streams}
        self.cameras: tuple[StreamInfo, ...] = tuple(info for info in streams if info.is_radiometric)
        self._sources = list(_sources(streams, settings))
        self.unknown: tuple[str, ...] = _unknown(self._sources)
        self._lux = _best(self._sources, "illuminance")
        self.light_source: Source | None = _required_light(self._sources, settings)
        self.model: IrradianceModel = _model_of(self.light_source, settings.irradiance)
        self._probes = {
            region: tuple(_probes(region, names, self._streams, settings))
            for region, names in settings.probes.items()
        }
        named = (probe.partition(":")[0] for names in settings.probes.values() for probe in names)
        self.absent: tuple[str, ...] = tuple(
            dict.fromkeys(name for name in named if name not in self._streams)
        )
        self._contacts = [
            Source(info, channel, "temperature", _bounds(info, settings))
            for info in streams
            if info.quantity == "temperature"
            for channel in range(info.shape[0])
        ]
        self._held: dict[tuple[str, int], tuple[int, float]] = {}

    @property
    def label(self) -> str:
        """The irradiance model in words, and whether it uses measured diffuse light."""
        uses_diffuse = self.model.kind == "pyranometer" and _best(self._sources, "dhi") is not None
        return f"{self.model.label}, dhi as measured" if uses_diffuse else self.model.label

    def light(self, minute: OpenBin, site: Site, settings: EstimatorSettings) -> MinuteIrradiance:
        """DNI of every light reading at its own time."""
        lux = self._lux.values(minute) if self._lux is not None else np.empty(0)
        source = self.light_source
        readings = minute.sorted_readings(source.info.name) if source is not None else []
        flags = Quality.GOOD
        for reading in readings:
            flags |= reading.quality
        times = np.array([reading.time_ns for reading in readings], np.int64)
        sun = sun_vectors(times, site, refraction=settings.refraction)
        sine = sun.reshape(-1, 3)[:, 2]
        values = source.values(minute, sine) if source is not None else np.empty(0)
        diffuse = self.mean(minute, "dhi", sine.mean() if sine.size else None)
        direct = direct_normal(self.model, values, sun, times, diffuse) if len(readings) else values
        # near the horizon even a clear sky changes as fast as a cloud
        high = sine >= np.sin(np.radians(settings.low_sun_deg))
        clearness = np.where(high, self._clearness(values, sun), np.nan)
        return MinuteIrradiance(readings, direct, clearness, mean_of(lux), diffuse, flags)

    def _clearness(self, values: FloatArray, sun: FloatArray) -> FloatArray:
        """Readings divided by the cosine of incidence on the meter, NaN for a grazing sun."""
        if self.model.is_direct or self.model.mounting == "sun-pointing":
            return values
        facet = VERTICAL
        if self.model.mounting == "in-plane":
            facet = normal(self.model.plane_tilt_deg, self.model.plane_azimuth_deg)
        cosine = sun.reshape(-1, 3) @ facet
        return np.asarray(values / np.where(cosine > 0.1, cosine, np.nan))

    def mean(self, minute: OpenBin, quantity: str, sine: float | None = None) -> float:
        """Mean of a component of radiation (W/m2), air temperature (K) or wind speed (m/s); NaN without.

        Means of more than a minute are held until the next is due: diffuse light, longwave and air change
        slowly, and assumed values would be less accurate. Minutes must come in order. `sine` is of the sun's
        elevation, which limits light.
        """
        source = _best(self._sources, quantity)
        return float("nan") if source is None else self._held_mean(minute, source, sine)

    def probe_k(self, minute: OpenBin, regions: Sequence[Region]) -> FloatArray:
        """Mean of the probes in each region, held as in `mean`, (regions,), K; empty if none has a probe."""
        if not self._probes:
            return np.empty(0)
        probes = [self._probes.get(region.name, ()) for region in regions]
        readings = ([self._held_mean(minute, probe) for probe in sources] for sources in probes)
        return np.array([mean_of(np.array(values)) for values in readings])

    def _held_mean(self, minute: OpenBin, source: Source, sine: float | None = None) -> float:
        key = source.info.name, source.channel
        mean = mean_of(source.values(minute, sine))
        if np.isfinite(mean):
            self._held[key] = minute.minute, mean
            return mean
        since, held = self._held.get(key, (0, float("nan")))
        due_minutes = OVERDUE / source.info.rate_hz / 60.0 if source.info.rate_hz > 0.0 else 0.0
        return held if minute.minute - since <= due_minutes else float("nan")

    def contact_k(self, minute: OpenBin) -> tuple[float, ...]:
        """Mean of each channel of all contact thermometers, kelvin."""
        return tuple(mean_of(contact.values(minute)) for contact in self._contacts)


def without_spikes(values: FloatArray, *, is_temperature: bool) -> FloatArray:
    """The readings of a minute in order of time (n,), NaN where one contradicts both neighbours.

    A second line of defence behind `fieldkit.model.limits`: a value that can be, such as 1600 W/m2 once in a
    clear hour, may still not have been measured. Two neighbours that agree with each other and not with the
    reading between them show it. Clouds, shade and gusts last longer than one reading, or make the neighbours
    disagree as well, so they stay. Readings without a value have no place in the order. Fewer than
    `LEAST_READINGS` are returned as they are.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if finite.size < LEAST_READINGS:
        return values
    v = values[finite]
    before = np.concatenate([v[2:3], v[:-1]])  # at the ends of the minute, the two on the other side
    after = np.concatenate([v[1:], v[-3:-2]])
    apart = np.minimum(np.abs(v - before), np.abs(v - after))
    least = LEAST_K if is_temperature else LEAST_SHARE * np.median(np.abs(v))
    agreement = np.maximum(np.abs(before - after), np.median(np.abs(np.diff(v))))
    cleaned = values.copy()
    cleaned[finite[apart > np.maximum(FACTOR * agreement, least)]] = np.nan
    return cleaned


def mean_of(values: FloatArray) -> float:
    """Mean of the finite values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")


def _sources(streams: Sequence[StreamInfo], settings: EstimatorSettings) -> Iterator[Source]:
    """Every channel that measures air or radiation, including those of unknown component."""
    for info in streams:
        bounds = _bounds(info, settings)
        if info.quantity == "illuminance":
            yield Source(info, 0, "illuminance", bounds)
        if info.name in settings.measures and info.unit != POWER.stored:
            problem = f"the stream is in {info.unit}, not in W/m2"
            fix = "name streams in W/m2 only; lux are converted by irradiance.model"
            raise ConfigError(problem, place=f"irradiance.measures.{info.name}", fix=fix)
        for channel, component in enumerate(radiation_components(info, settings.measures)):
            if (component, info.quantity) == ("", "irradiance") and settings.irradiance.is_direct:
                component = "dni"  # irradiance.model states it: pyrheliometer, or a file of direct light
            yield Source(info, channel, component, bounds)
        air = enumerate(air_quantities(info))
        yield from (Source(info, channel, word, bounds) for channel, word in air if word)


def _bounds(info: StreamInfo, settings: EstimatorSettings) -> Bounds:
    return bounds_of(info, settings.limits, settings.measures)


def _probes(
    region: str, names: Sequence[str], streams: Mapping[str, StreamInfo], settings: EstimatorSettings
) -> Iterator[Source]:
    """The channels of the probes in a region; streams that are not there are skipped."""
    for probe in names:
        name, _, text = probe.partition(":")
        if (info := streams.get(name)) is None:
            continue
        if info.quantity != "temperature":
            have = ", ".join(stream.name for stream in streams.values() if stream.quantity == "temperature")
            problem = f"{name} measures {info.quantity}, so {probe} is not a contact thermometer"
            raise ConfigError(problem, place=f"region {region}", fix=f"name a thermometer: {have or 'none'}")
        if (channel := info.channel(text)) is None:
            fix = f"correct probes; channels of {name}: {', '.join(info.channel_names)}"
            raise ConfigError(f"{name} has no channel {text!r}", place=f"region {region}", fix=fix)
        if air_quantities(info)[channel] == AIR_TEMPERATURE:
            problem = f"{probe} is named as air temperature, so it is not in the bed"
            fix = "correct probes, or give the channel another name in the option labels"
            raise ConfigError(problem, place=f"region {region}", fix=fix)
        yield Source(info, channel, "temperature", _bounds(info, settings))


def _unknown(sources: Sequence[Source]) -> tuple[str, ...]:
    """Streams of which no channel's component is known."""
    identified = {source.info.name for source in sources if source.measures}
    return tuple(dict.fromkeys(source.info.name for source in sources if source.info.name not in identified))


def sunlight_source(streams: Sequence[StreamInfo], settings: EstimatorSettings) -> Source | None:
    """The channel that DNI is derived from; None if no channel is known to measure sunlight."""
    return _light(list(_sources(streams, settings)), settings)


def _light(sources: Sequence[Source], settings: EstimatorSettings) -> Source | None:
    """The best allowed channel."""
    allowed = SUNLIGHT[:1] if settings.irradiance.is_direct else SUNLIGHT
    return _best(_candidates(sources, settings), *allowed)


def _best(sources: Sequence[Source], *components: str) -> Source | None:
    """The best channel of these components: measured in most minutes, then first in the list."""
    matches = [source for source in sources if source.measures in components]
    return min(matches, key=lambda one: (one.is_slow, components.index(one.measures)), default=None)


def _candidates(sources: Sequence[Source], settings: EstimatorSettings) -> list[Source]:
    return [source for source in sources if settings.light_stream in ("", source.info.name)]


def _required_light(sources: Sequence[Source], settings: EstimatorSettings) -> Source | None:
    """As `_light`; raises `ConfigError` if a complete configuration would give sunlight."""
    if (light := _light(sources, settings)) is not None:
        return light
    for candidate in _candidates(sources, settings):
        _refuse(candidate, settings.irradiance)
    have = ", ".join(dict.fromkeys(source.info.name for source in sources if source.measures in SUNLIGHT))
    if settings.light_stream and have:  # without any light the frames alone may still be viewed
        problem = f"{settings.light_stream!r} is not a stream of sunlight"
        raise ConfigError(problem, place="irradiance.stream", fix=f"name a stream of sunlight: {have}")
    return None


def _refuse(source: Source, model: IrradianceModel) -> None:
    """Raise `ConfigError` for a channel that would be used if its component were known or allowed."""
    name = source.info.name
    if source.measures == "" and source.info.quantity == "irradiance":
        raise ConfigError(
            "in W/m2, but what it measures is not known, so it cannot be used as sunlight",
            place=name,
            fix=f"{how_to_state(name)}: a level pyranometer, a pyrheliometer, a tilted one, a shaded one, "
            "a pyrgeometer",
        )
    if source.measures in ("ghi", "gti"):
        problem = f'"{model.kind}" takes direct light, but {name} measures {source.measures}'
        fix = f'omit irradiance.model, or set irradiance.measures.{name} = "dni"'
        raise ConfigError(problem, place="irradiance.model", fix=fix)


def _model_of(source: Source | None, model: IrradianceModel) -> IrradianceModel:
    """The irradiance model of a source: the light meter's for lux, its own for W/m2."""
    if source is None or source.measures == "illuminance":
        return model
    if source.measures == "dni":
        return IrradianceModel(kind="file" if model.kind == "file" else "pyrheliometer")
    name = f"{source.info.name} measures {source.measures}"
    if source.measures == "ghi":
        return pyranometer(replace(model, mounting="horizontal"), name)
    if model.mounting == "horizontal":
        raise ConfigError(
            f"{name}, but the plane it lies in is not known",
            place="irradiance.mounting",
            fix='set irradiance.mounting = "in-plane" with plane_tilt_deg and plane_azimuth_deg, '
            'or "sun-pointing"',
        )
    return pyranometer(model, name)


def pyranometer(model: IrradianceModel, what: str) -> IrradianceModel:
    """The model for global irradiance in W/m2 on the same plane; `what` is measured, for the error.

    Raises `ConfigError` if the model does not remove diffuse light.
    """
    if model.diffuse == "none":
        problem = f'"none", but {what}, which contains the light of the sky'
        fix = 'set irradiance.diffuse = "fraction" or "erbs"; "none" is for a baffled tube'
        raise ConfigError(problem, place="irradiance.diffuse", fix=fix)
    return replace(model, kind="pyranometer")
