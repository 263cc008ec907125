"""Regions that change while a session is recorded: every outline once, and the minutes in which it holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from fieldkit.model.arrays import IntArray
from fieldkit.model.site import Region, RegionKind, RegionRecord
from fieldkit.model.units import MINUTE_NS

T = TypeVar("T")
_ALWAYS, _NEVER = -(2**62), 2**62


@dataclass(frozen=True, slots=True)
class RegionSchedule:
    """Outlines as columns that are only ever appended: a region that is redrawn gets a new column.

    `columns` are in the order they were drawn, each holds in minutes since 1970 UTC from `since` to before
    `until`.
    """

    columns: tuple[Region, ...]
    since: tuple[int, ...]
    until: tuple[int, ...]

    @classmethod
    def of(cls, regions: Regions) -> RegionSchedule:
        """Regions that hold all the time; a schedule as it is."""
        if isinstance(regions, RegionSchedule):
            return regions
        return cls(tuple(regions), (_ALWAYS,) * len(regions), (_NEVER,) * len(regions))

    def with_record(self, record: RegionRecord) -> RegionSchedule:
        """The schedule with a region added, redrawn or removed; the same one where nothing changes."""
        minute, region = -(-record.time_ns // MINUTE_NS), record.region
        drawn = {last.name: i for i, last in enumerate(self.columns) if self.until[i] == _NEVER}
        column = drawn.get(region.name)
        if column is not None and not record.is_removed and _is_same_place(self.columns[column], region):
            # a slope measured afterwards is only compared with: learning goes on
            return replace(self, columns=_with(self.columns, column, region))
        ended = self if column is None else replace(self, until=_with(self.until, column, minute))
        if record.is_removed:
            return ended
        return RegionSchedule((*ended.columns, region), (*ended.since, minute), (*ended.until, _NEVER))

    def at(self, minute: int) -> IntArray:
        """Columns that hold in a minute, in the order in which their names came first."""
        names = self.names
        active = [i for i in range(len(self.columns)) if self.since[i] <= minute < self.until[i]]
        return np.array(sorted(active, key=lambda i: names.index(self.columns[i].name)), np.int64)

    def regions_at(self, minute: int) -> tuple[Region, ...]:
        """The regions that hold in a minute."""
        return tuple(self.columns[column] for column in self.at(minute))

    def column(self, name: str, minute: int) -> int | None:
        """The column of a region in a minute, None where it has none then."""
        return next((int(i) for i in self.at(minute) if self.columns[i].name == name), None)

    @property
    def names(self) -> list[str]:
        """Every name once, in the order in which they came first."""
        return list(dict.fromkeys(region.name for region in self.columns))

    @property
    def latest(self) -> tuple[Region, ...]:
        """Every region once, as it was drawn last; also those that were removed."""
        return tuple({region.name: region for region in self.columns}.values())

    @property
    def is_constant(self) -> bool:
        """True if all regions hold all the time."""
        return all(minute == _ALWAYS for minute in self.since) and all(end == _NEVER for end in self.until)

    def is_redrawn(self, column: int) -> bool:
        """True if the region of a column had another outline before."""
        return any(earlier.name == self.columns[column].name for earlier in self.columns[:column])

    def versions(self, name: str) -> Iterator[tuple[Region, int, int]]:
        """The outlines of a region, each with the minutes from and until which it holds."""
        for region, since, until in zip(self.columns, self.since, self.until, strict=True):
            if region.name == name:
                yield region, since, until


Regions = Sequence[Region] | RegionSchedule
"""Regions that hold all the time, or that change."""


def _is_same_place(one: Region, other: Region) -> bool:
    """True if what is estimated of two targets is the same: they differ at most in the given tilt."""
    tilt = float("nan")
    if RegionKind.REFERENCE in (one.kind, other.kind):
        return repr(one) == repr(other)
    return repr(replace(one, tilt_deg=tilt)) == repr(replace(other, tilt_deg=tilt))  # NaN is equal to NaN


def _with(values: tuple[T, ...], place: int, value: T) -> tuple[T, ...]:
    return (*values[:place], value, *values[place + 1 :])
