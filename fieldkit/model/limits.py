"""Limits of each quantity: a value beyond its limits was not measured, whatever its flags state.

The one table for every door by which a number comes in: meters, imports, tables of temperatures, session
files on reading. Such a value is stored as it came and its sample is flagged `Quality.IMPLAUSIBLE`; whatever
computes takes the channel as without a value, by these limits and not by the flag, so that files of any age
and drivers of any origin are treated alike.

Sources: BSRN is C. N. Long and E. G. Dutton, "BSRN Global Network recommended QC tests, V2.0", 2002,
physically possible limits; WMO the World Weather and Climate Extremes Archive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from fieldkit.model.air import CELSIUS_UNITS, of_air
from fieldkit.model.arrays import AnyIntArray, BoolArray, FloatArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.radiation import UNIT, measured
from fieldkit.model.samples import Frame, Quality, Sample, is_usable
from fieldkit.model.units import CELSIUS_ZERO_K

Range = tuple[float, float]
S = TypeVar("S", bound=Sample)

SUN_W_M2 = 1361.0 / 0.9833**2
"""Above the atmosphere at perihelion: total solar irradiance of Kopp and Lean, 2011, at 0.9833 au."""
ZERO_OFFSET_W_M2 = -41.0
"""Total zero offset of the worst class of pyranometers, ISO 9060:2018, class C: below it nothing is light."""
EFFICACY_LM_W = 120.0
"""No global daylight has more lumens per watt; P. J. Littlefair, Lighting Res. Technol. 17, 1985."""


class Limit(NamedTuple):
    """Least and greatest value of a quantity in K, W/m2, lx or m/s.

    Sunlight also depends on the sun: at a sine `s` of its elevation no more than
    ``by_sun[0] * max(s, 0)**1.2 + by_sun[1]``.
    """

    low: float
    high: float
    by_sun: Range | None = None


def _sunlight(share: float, offset_w_m2: float) -> Limit:
    """Limits of BSRN: a share of the sun's light, by the power 1.2 of its sine; `high` is for the zenith."""
    rise = share * SUN_W_M2
    return Limit(ZERO_OFFSET_W_M2, rise + offset_w_m2, (rise, offset_w_m2))


_GLOBAL = _sunlight(1.5, 100.0)  # with light from the edges of clouds; BSRN
_BEAM = (SUN_W_M2 / math.sin(math.radians(0.5)) ** 1.2, 100.0)
"""All of the sun's light from half a degree on; a summit sees it, weak, two degrees below the horizontal."""
_ILLUMINANCE = (EFFICACY_LM_W * _BEAM[0], EFFICACY_LM_W * _BEAM[1])
"""The same for a meter, which may face the sun."""
_HOTTEST_K = 440.0
"""A black surface that only radiates, under all that sun and sky give: (1408 + 700) W/m2 / sigma, 439 K."""

LIMITS: Mapping[str, Limit] = {
    "air_temperature": Limit(183.9, 350.0),  # -89.2 degC, Vostok 1983, WMO; 350 K, BSRN: housings in the sun
    "probe_temperature": Limit(175.0, _HOTTEST_K),  # -98 degC, Scambos et al., Geophys. Res. Lett. 45, 2018
    "surface_temperature": Limit(175.0, _HOTTEST_K),
    "illuminance": Limit(0.0, EFFICACY_LM_W * _GLOBAL.high, _ILLUMINANCE),
    "dni": Limit(ZERO_OFFSET_W_M2, SUN_W_M2, _BEAM),  # BSRN, and none from a sun that is down
    "ghi": _GLOBAL,
    "gti": _GLOBAL._replace(by_sun=None),  # the plane may face a sun that is low
    "dhi": _sunlight(0.95, 50.0),  # BSRN
    "irradiance": Limit(-400.0, _GLOBAL.high),  # of an unknown component, so also net radiation
    "longwave_down": Limit(40.0, 700.0),  # BSRN
    "longwave_up": Limit(40.0, 900.0),  # BSRN
    "wind_speed": Limit(0.0, 113.3),  # gust of 113.2 m/s, Barrow Island 1996, WMO
}  # fmt: skip


class Rare(NamedTuple):
    """Least and greatest value that is not extremely rare, W/m2.

    The greatest is ``share * top * max(s, 0)**power + high`` for light of `top` above the atmosphere and a
    sine `s` of the sun's elevation.
    """

    low: float
    high: float
    share: float = 0.0
    power: float = 1.0


RARE: Mapping[str, Rare] = {  # BSRN, extremely rare limits
    "ghi": Rare(-2.0, 50.0, 1.2, 1.2),
    "dhi": Rare(-2.0, 30.0, 0.75, 1.2),
    "dni": Rare(-2.0, 10.0, 0.95, 0.2),
    "longwave_down": Rare(60.0, 500.0),
}


def is_rare(name: str, values: FloatArray, sine: FloatArray, top_w_m2: FloatArray) -> BoolArray:
    """True where a component of `RARE` is possible, but extremely rare; False for NaN."""
    rare = RARE[name]
    high = rare.share * top_w_m2 * np.maximum(sine, 0.0) ** rare.power + rare.high
    return np.asarray((values < rare.low) | (values > high))


_ELSEWHERE: Mapping[str, Range] = {
    # 25 K in shadows at the Moon's poles: Paige et al., Science 330, 2010
    **dict.fromkeys(("air_temperature", "probe_temperature", "surface_temperature"), (20.0, _HOTTEST_K)),
    "longwave_down": (-5.0, 700.0),  # none on the Moon, where a pyrgeometer shows its own noise
    "longwave_up": (-5.0, 900.0),
}

_BY_UNIT = {
    "lx": "illuminance", UNIT: "irradiance", "m s-1": "wind_speed",
    **dict.fromkeys(("K", *CELSIUS_UNITS), "probe_temperature"),
}  # fmt: skip

_UNITS = {"_c": CELSIUS_ZERO_K, "_lx": 0.0, "_w_m2": 0.0, "_m_s": 0.0}
"""Suffixes of the keys of a configuration, and what to add to a value."""
_KEYS = {f"{name}{unit}": (name, zero) for name in LIMITS for unit, zero in _UNITS.items()}


def shown(key: str) -> Range:
    """The row of the table by a configuration's key, such as ``air_temperature_c``, in its unit."""
    name, zero = _KEYS[key]
    return LIMITS[name].low - zero, LIMITS[name].high - zero


def rows_of(stated: Mapping[str, Sequence[float]], body: str) -> dict[str, Range]:
    """The rows that differ from the table: those of another world than the Earth, and those stated.

    `stated` are ranges by a configuration's key, in its unit; the rows are by name, in SI units.
    """
    rows = {} if body == "earth" else dict(_ELSEWHERE)
    for key, (low, high) in stated.items():
        name, zero = _KEYS[key]
        rows[name] = low + zero, high + zero
    return rows


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of a stream's channels in its unit, (channels,): `low`, `high`; by the sun `rise`, `offset`."""

    low: FloatArray
    high: FloatArray
    rise: FloatArray
    offset: FloatArray

    @property
    def depend_on_sun(self) -> bool:
        """True if a channel's limit depends on the sun's elevation."""
        return bool((self.rise > 0.0).any())

    def exceeded(self, values: FloatArray, sine: FloatArray | float | None = None) -> BoolArray:
        """True for values (..., channels) that cannot be; False for NaN.

        `sine`, (...) or one for all, is of the sun's elevation, if known.
        """
        high = self.high
        if sine is not None and self.depend_on_sun:
            s = np.maximum(np.asarray(sine)[..., np.newaxis], 0.0)
            high = np.minimum(high, np.where(self.rise > 0.0, self.rise * s**1.2 + self.offset, np.inf))
        return np.asarray((values < self.low) | (values > high))

    def usable(
        self,
        values: FloatArray,
        flags: AnyIntArray,
        sine: FloatArray | float | None = None,
    ) -> FloatArray:
        """Values (..., channels) for whatever computes: NaN where flags (...) or limits exclude them."""
        excluded = self.exceeded(values, sine) | ~is_usable(flags)[..., np.newaxis]
        return np.where(excluded, np.nan, values)


@dataclass(frozen=True, slots=True)
class Excess:
    """Number of values of a channel beyond its limits, and the first of them, by its place and value."""

    channel: str
    count: int
    first: int
    value: float
    limit: Range
    unit: str

    def words(self, where: str) -> str:
        """In words; `where` names the row or time of the first, behind "at"."""
        count = f"{self.count} implausible {'value' if self.count == 1 else 'values'}"
        low, high = self.limit
        value = f"{self.value:.6g} {self.unit}".rstrip()
        possible = f"possible: {low:.4g} to {high:.4g}"
        if low <= self.value <= high:
            possible = "more than the sun gives at its height then; are place and time right?"
        return f"{self.channel}: {count}, the first {value} at {where}; {possible}"


def excesses(
    labels: Sequence[tuple[str, str]], bounds: Bounds, values: FloatArray, exceeded: BoolArray
) -> list[Excess]:
    """Each channel with values (n, channels) beyond its limits; `labels` are names and units of all channels.

    `exceeded` (n, channels) is what `Bounds.exceeded` found.
    """
    found = []
    for place in np.flatnonzero(exceeded.any(axis=0)).tolist():
        first, count = int(np.argmax(exceeded[:, place])), int(np.count_nonzero(exceeded[:, place]))
        limit = float(bounds.low[place]), float(bounds.high[place])
        name, unit = labels[place]
        found.append(Excess(name, count, first, float(values[first, place]), limit, unit))
    return found


def labels_of(info: StreamInfo) -> list[tuple[str, str]]:
    """Names and units of a meter's channels for `excesses`."""
    several = info.shape[0] > 1
    return [(f"{info.name} {name}" if several else info.name, info.unit) for name in info.channel_names]


def flagged(sample: S, bounds: Bounds) -> S:
    """The sample, flagged `IMPLAUSIBLE` if it is a reading with a channel beyond its limits."""
    if isinstance(sample, Frame) or not bounds.exceeded(np.array(sample.values)).any():
        return sample
    return sample._replace(quality=sample.quality | Quality.IMPLAUSIBLE)


def bounds_of(
    info: StreamInfo,
    rows: Mapping[str, Range] = MappingProxyType({}),
    stated: Mapping[str, str] = MappingProxyType({}),
) -> Bounds:
    """The limits of a stream's channels, of a camera's kelvin; infinite where the quantity is unknown.

    `rows` replace rows of the table and of the stream (`rows_of`), `stated` are components of radiation by
    stream, from the configuration.
    """
    zero = CELSIUS_ZERO_K if info.unit in CELSIUS_UNITS else 0.0
    return bounds_by_name(_names(info, stated), {**info.limits, **rows}, zero)


def bounds_by_name(names: Sequence[str], rows: Mapping[str, Range], zero: float = 0.0) -> Bounds:
    """The limits of quantities by their names in the table, less `zero`; see `bounds_of`."""
    unknown = Limit(-np.inf, np.inf)
    limits = [Limit(*rows[name]) if name in rows else LIMITS.get(name, unknown) for name in names]
    by_sun = [limit.by_sun or (0.0, 0.0) for limit in limits]
    low, high, rise, offset = np.array(
        [(one.low - zero, one.high - zero, *sun) for one, sun in zip(limits, by_sun, strict=True)]
    ).T
    return Bounds(low, high, rise, offset)


def _names(info: StreamInfo, stated: Mapping[str, str]) -> tuple[str, ...]:
    """The row of the table for each channel, "" where there is none."""
    if info.is_camera:
        return ("surface_temperature" if info.quantity == "brightness_temperature" else "",)
    usual = _BY_UNIT.get(info.unit, "")
    known = measured(info, stated) or of_air(info)
    names = known if len(known) == info.shape[0] else known * info.shape[0]
    return tuple(name or usual for name in names)
