"""Limits of each quantity: a value beyond its limits was not measured, whatever its flags state.

The limits are those of `fieldkit.model.quantities`, for every door by which a number comes in: meters,
imports, tables of temperatures, session files on reading. Such a value is stored as it came and its sample
is flagged `Quality.IMPLAUSIBLE`; whatever computes takes the channel as without a value, by these limits and
not by the flag, so that files of any age and drivers of any origin are treated alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from fieldkit.model.arrays import AnyIntArray, BoolArray, FloatArray
from fieldkit.model.channels import air_quantities, quantity_of, radiation_components
from fieldkit.model.device import StreamInfo
from fieldkit.model.quantities import LIMITS, QUANTITIES, Limit, Meaning, Range, Rare
from fieldkit.model.samples import Frame, Quality, Sample, is_usable
from fieldkit.phrases import Words

S = TypeVar("S", bound=Sample)

RARE: Mapping[str, Rare] = {name: row.rare for name, row in QUANTITIES.items() if row.rare}
"""Values of components that are not extremely rare."""


def is_rare(name: str, values: FloatArray, sine: FloatArray, top_w_m2: FloatArray) -> BoolArray:
    """True where a component of `RARE` is possible, but extremely rare; False for NaN."""
    rare = RARE[name]
    high = rare.share * top_w_m2 * np.maximum(sine, 0.0) ** rare.power + rare.high
    return np.asarray((values < rare.low) | (values > high))


def changed_rows(stated: Mapping[str, Sequence[float]], body: str) -> dict[str, Range]:
    """The limits that differ from the table: those of another world than the Earth, and those stated.

    `stated` are ranges by a configuration's key, in its unit; the rows are by name, in the unit of streams.
    """
    rows = {} if body == "earth" else {key: row.elsewhere for key, row in LIMITS.items() if row.elsewhere}
    for key, row in LIMITS.items():
        if ends := stated.get(row.limits_key):
            low, high = (Meaning(row, row.shown).in_stream_unit(end) for end in ends)
            rows[key] = low, high
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

    def is_exceeded(self, values: FloatArray, sine: FloatArray | float | None = None) -> BoolArray:
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
        excluded = self.is_exceeded(values, sine) | ~is_usable(flags)[..., np.newaxis]
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
        low, high = self.limit
        key = "issue.excess.sun" if low <= self.value <= high else "issue.excess"
        value = f"{self.value:.6g} {self.unit}".rstrip()
        limits = {"low": f"{low:.4g}", "high": f"{high:.4g}"}
        return Words(key, channel=self.channel, count=self.count, value=value, where=where, **limits)


def excesses(
    labels: Sequence[tuple[str, str]], bounds: Bounds, values: FloatArray, exceeded: BoolArray
) -> list[Excess]:
    """Each channel with values (n, channels) beyond its limits; `labels` are names and units of all channels.

    `exceeded` (n, channels) is what `Bounds.is_exceeded` found.
    """
    channels = []
    for place in np.flatnonzero(exceeded.any(axis=0)).tolist():
        first, count = int(np.argmax(exceeded[:, place])), int(np.count_nonzero(exceeded[:, place]))
        limit = float(bounds.low[place]), float(bounds.high[place])
        name, unit = labels[place]
        channels.append(Excess(name, count, first, float(values[first, place]), limit, unit))
    return channels


def labels_of(info: StreamInfo) -> list[tuple[str, str]]:
    """Names and units of a meter's channels for `excesses`."""
    several = info.shape[0] > 1
    return [(f"{info.name} {name}" if several else info.name, info.unit) for name in info.channel_names]


def flag_implausible(sample: S, bounds: Bounds) -> S:
    """The sample, flagged `IMPLAUSIBLE` if it is a reading with a channel beyond its limits."""
    if isinstance(sample, Frame) or not bounds.is_exceeded(np.array(sample.values)).any():
        return sample
    return sample._replace(quality=sample.quality | Quality.IMPLAUSIBLE)


def bounds_of(
    info: StreamInfo,
    rows: Mapping[str, Range] = MappingProxyType({}),
    stated: Mapping[str, str] = MappingProxyType({}),
) -> Bounds:
    """The limits of a stream's channels, of a camera's kelvin; infinite where the quantity is unknown.

    `rows` replace rows of the table and of the stream (`changed_rows`), `stated` are components of radiation
    by stream, from the configuration.
    """
    row = quantity_of(info)
    usual = row.key or row.name
    names: tuple[str, ...] = (usual if info.quantity == "brightness_temperature" else "",)
    if not info.is_camera:
        measured = radiation_components(info, stated) or air_quantities(info)
        channels = measured if len(measured) == info.shape[0] else measured * info.shape[0]
        names = tuple(name or usual for name in channels)
    return bounds_by_name(names, {**info.limits, **rows})


def bounds_by_name(names: Sequence[str], rows: Mapping[str, Range]) -> Bounds:
    """The limits of quantities by their names in ``[limits]``; see `bounds_of`."""
    limits = [
        Limit(*rows[name]) if name in rows else LIMITS[name].limit if name in LIMITS else Limit()
        for name in names
    ]
    ends = [(limit.low, limit.high, *(limit.by_sun or (0.0, 0.0))) for limit in limits]
    return Bounds(*np.array(ends).T)
