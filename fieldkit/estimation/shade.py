"""The shade test: a board over one region for some minutes, found in the temperatures or marked by hand.

Under the board a region loses the beam and nothing else changes, so its sunlight must be known as gone to
the minute. `ShadeTestMonitor` finds it: the heat that the ground takes up, less the heat lost for being
warmer, is the absorbed sunlight up to a constant, which falls and returns like the board itself. Nominal
sand serves for any ground, since only the ratio to the depth of the fall counts. `ShadeMarks` holds what the
operator marked. `ShadedMinutes` joins both and says which earlier minutes have to be flagged otherwise now.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from fieldkit.estimation.bins import pad
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.marks import SHADE_TEST_S, corrected_events
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.samples import Event
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.physics.slab import Slab, conducted_flux

NOMINAL = Slab()
LOSS_W_M2_K = 25.0
"""Exchange with the air and longwave of sand in the open: 18 W m-2 K-1 of the paper's and 4 e sigma T^3."""
MEMORY = 60
LEAST_LIT = 10
LEVEL_OF = 5
"""Minutes of memory of the ground, of lit minutes needed, and of those whose mean is the level before."""
# judged: because a board takes the whole beam, of which sand absorbs hundreds of W/m2 in a useful sun
LEAST_FALL_W_M2 = 100.0
SIGMAS = 6.0  # judged: because every minute of every region is a test for a board
ALONE = 0.25
"""Largest change of the other regions, as a share of the fall: a cloud changes them all."""
SHARP = 0.7
"""Share of the depth that the second minute of a board has; a creeping shadow has less."""
PARTLY = 0.2
"""Share of the depth above which a minute at the end counts as partly shaded: the first six seconds of it."""
PARTLY_BEFORE = 0.05
"""The same for the minute before the fall was seen: the last eight seconds of it."""
SHORTEST_MIN, LONGEST_MIN = 2, 20  # what lasts longer counts as weather (`disturbances`)

Cell = tuple[int, int]
"""Minute since 1970 UTC and column of a region."""


@dataclass(frozen=True, slots=True)
class ShadeTest:
    """A shade test that is over: the region's column, begin and end in UTC nanoseconds."""

    column: int
    begin_ns: int
    end_ns: int


@dataclass(slots=True)
class _Shade:
    """One region in the shade: the level before, and the fall below it minute by minute."""

    level: float
    falls: dict[int, float]

    @property
    def depth(self) -> float:
        """The fall under the whole board, in W/m2."""
        # without the two least: the board came and went within these minutes
        return float(np.median(sorted(self.falls.values())[-max(1, len(self.falls) - 2) :]))

    @property
    def is_sharp(self) -> bool:
        """True if it came within two minutes and went within two."""
        falls = [fall / self.depth for fall in self.falls.values()]
        return len(falls) >= SHORTEST_MIN and max(falls[:2]) >= SHARP and max(falls[-2:]) >= SHARP

    def trim_end(self, after: float) -> list[int]:
        """Take away the last minutes that were as sunny as those after them, and return them.

        Ground that loses its heat otherwise than nominal sand does not come back to its level at once.
        """
        depth, lit = self.depth, list[int]()
        for minute, fall in reversed(list(self.falls.items())[1:]):
            if fall - after > PARTLY * depth:
                break
            after = self.falls.pop(minute)
            lit.append(minute)
        return lit

    def test(self, column: int) -> ShadeTest:
        """Begin and end: after a time t of a minute in the sun its mean has fallen by (1 - t)^1.5."""
        ((first, begins), *_, (last, ends)) = self.falls.items()
        at_first = np.clip(begins / self.depth, 0.0, 1.0) ** (2.0 / 3.0)
        sun_at_last = np.clip(1.0 - ends / self.depth, 0.0, 1.0) ** (2.0 / 3.0)
        begin_ns = (first + 1) * MINUTE_NS - round(float(at_first) * MINUTE_NS)
        return ShadeTest(column, begin_ns, (last + 1) * MINUTE_NS - round(float(sun_at_last) * MINUTE_NS))


class ShadeTestMonitor:
    """Finds a region that alone loses its sun sharply, and when it has it again, from minute temperatures.

    `shaded` holds the minutes and columns found so far. Without other regions nothing can be found; one that
    does not hold in a minute has no temperature in it.
    """

    def __init__(self) -> None:
        self.shaded: set[Cell] = set()
        self._kelvin: deque[tuple[int, FloatArray]] = deque()
        self._lit: deque[FloatArray] = deque(maxlen=LEAST_LIT)
        self._before: tuple[int, FloatArray] | None = None
        self._active: dict[int, _Shade] = {}

    @property
    def columns(self) -> set[int]:
        """The regions that are in the shade now."""
        return set(self._active)

    def update(self, minute: int, temperature_k: FloatArray, is_cloudy: bool) -> list[ShadeTest]:
        """Take the temperatures (regions,) of a minute; returns the tests that have ended with it."""
        if not np.isfinite(temperature_k).any():
            return []
        self._widen(temperature_k.size)
        sunlight = self._sunlight_w_m2(minute, temperature_k)
        ended = self._end_shades(minute, sunlight)
        if len(self._lit) >= LEAST_LIT and not is_cloudy:
            self._begin(minute, sunlight)
        if not self._active:
            self._lit.append(sunlight)
        self._before = (minute, sunlight)
        return ended

    def cooling_k(self, minute: int, column: int) -> float:
        """How far a region has cooled more than the others since two minutes before; NaN if unknown."""
        kelvin = dict(self._kelvin)
        if minute not in kelvin or minute - 2 not in kelvin:
            return float("nan")
        cooling = kelvin[minute - 2] - kelvin[minute]
        others = np.delete(cooling, column)
        others = others[np.isfinite(others)]
        return float(cooling[column] - np.median(others)) if others.size else float("nan")

    def _widen(self, regions: int) -> None:
        """Give a region that was drawn later its place in what is remembered."""
        if not self._kelvin or self._kelvin[0][1].size == regions:
            return
        self._kelvin = deque((minute, pad(kelvin, regions)) for minute, kelvin in self._kelvin)
        self._lit = deque((pad(values, regions) for values in self._lit), maxlen=LEAST_LIT)
        if self._before is not None:
            self._before = self._before[0], pad(self._before[1], regions)

    def _sunlight_w_m2(self, minute: int, temperature_k: FloatArray) -> FloatArray:
        """Absorbed sunlight of the regions up to a constant, as of nominal sand."""
        while self._kelvin and minute - self._kelvin[0][0] > MEMORY:
            self._kelvin.popleft()
        self._kelvin.append((minute, temperature_k))
        minutes = np.arange(self._kelvin[0][0], minute + 1)
        found_at, kelvin = np.array([at for at, _ in self._kelvin]), np.array([k for _, k in self._kelvin])
        even = np.column_stack([_fill_gaps(minutes, found_at, column) for column in kelvin.T])
        # what the sand takes up, and what a warmer region loses more than another
        return np.asarray(conducted_flux(NOMINAL, even, 60.0)[-1] + LOSS_W_M2_K * temperature_k)

    def _begin(self, minute: int, sunlight: FloatArray) -> None:
        """Begin the shade of the region that has fallen most, if it did so alone and sharply."""
        levels = np.asarray(np.mean(list(self._lit)[-LEVEL_OF:], axis=0))
        falls = levels - sunlight
        falls[list(self._active)] = np.nan
        if np.isfinite(falls).sum() < 2:
            return
        column = int(np.nanargmax(falls))
        others = np.delete(falls, column)
        fall, common = float(falls[column]), float(np.nanmedian(others))
        least = max(LEAST_FALL_W_M2, SIGMAS * self._noise(column))
        if fall - common < least or np.nanmax(np.abs(others)) > ALONE * fall:
            return
        earlier = self._earlier(minute, column, levels)
        if earlier > ALONE * fall:
            return
        shade = _Shade(float(levels[column]), {})
        if earlier > max(PARTLY_BEFORE * fall, 0.5 * least):
            shade.falls[minute - 1] = earlier
        shade.falls[minute] = fall
        self._active[column] = shade
        self.shaded |= {(fall, column) for fall in shade.falls}

    def _earlier(self, minute: int, column: int, levels: FloatArray) -> float:
        """The fall in the minute before, which may have been shaded in part; 0 if it was not measured."""
        if self._before is None or self._before[0] != minute - 1:
            return 0.0
        return float(np.nan_to_num(levels[column] - self._before[1][column]))

    def _noise(self, column: int) -> float:
        """Scatter of a region against the others, lately, in W/m2."""
        lit = np.array(self._lit)
        others = np.delete(lit, column, axis=1)
        is_comparable = np.isfinite(lit[:, column]) & np.isfinite(others).any(axis=1)
        alone = lit[is_comparable, column] - np.nanmedian(others[is_comparable], axis=1)
        # differences know no slow change, and have twice the variance
        return float(np.std(np.diff(alone)) / np.sqrt(2.0)) if alone.size > 1 else 0.0

    def _end_shades(self, minute: int, sunlight: FloatArray) -> list[ShadeTest]:
        """Carry on with the shaded regions; the tests that are over."""
        ended = []
        for column, shade in list(self._active.items()):
            fall = shade.level - float(sunlight[column])
            if minute - next(iter(shade.falls)) > LONGEST_MIN:
                del self._active[column]  # no test: the new level counts as normal
            elif fall > PARTLY * shade.depth:
                shade.falls[minute] = fall
                self.shaded.add((minute, column))
            elif np.isfinite(fall):
                del self._active[column]
                self.shaded -= {(lit, column) for lit in shade.trim_end(fall)}
                ended += [shade.test(column)] if shade.is_sharp else []
        return ended


def _fill_gaps(minutes: IntArray, found_at: IntArray, kelvin: FloatArray) -> FloatArray:
    """A temperature at every minute, linear across minutes without one; NaN if there is none at all."""
    is_finite = np.isfinite(kelvin)
    if not is_finite[-1]:
        return np.full(minutes.size, np.nan)
    return np.asarray(np.interp(minutes, found_at[is_finite], kelvin[is_finite]))


@dataclass(slots=True)
class ShadeMarks:
    """Shade tests that the operator marked; a mark counts from the minute in which it was made.

    One that corrects another counts from its own time.
    """

    _events: list[Event] = field(default_factory=list)
    _first: int | None = None

    def add(self, event: Event) -> None:
        """Take a mark; one that is not about the shade of a region may become one."""
        self._events.append(event)

    def tests(self, minute: int, schedule: RegionSchedule, *, is_last: bool) -> list[ShadeTest]:
        """The tests marked by the end of a minute, up to then; `is_last` counts marks made later too.

        A mark is about the region as it was drawn when the mark was made. One before the first minute asked
        for is outside the recording, and no test.
        """
        self._first = minute if self._first is None else self._first
        marked = [
            (noted, column, event)
            for event in corrected_events(self._events)
            if "shade_test" in event.data and event.time_ns // MINUTE_NS >= self._first
            if (noted := _noted_minute(event)) <= minute or is_last
            if (column := schedule.column(str(event.data["shade_test"]), noted)) is not None
        ]
        marked.sort(key=lambda mark: (mark[2].time_ns, mark[0], mark[2].text))
        tests, begun = [], dict[int, Event]()
        for _, column, event in marked:
            if "end_ns" in event.data:
                tests.append(ShadeTest(column, event.time_ns, int(event.data["end_ns"])))
            elif column in begun:
                tests.append(_until(column, begun.pop(column), event.time_ns))
            if event.data.get("phase") == "begin":
                begun[column] = event
        return [*tests, *(_until(column, begin, (minute + 1) * MINUTE_NS) for column, begin in begun.items())]

    def just_begun(self, minute: int, schedule: RegionSchedule) -> set[int]:
        """Columns whose test was marked as begun in the minute before."""
        begins = (event for event in corrected_events(self._events) if event.data.get("phase") == "begin")
        names = (begin.data["shade_test"] for begin in begins if _noted_minute(begin) == minute - 1)
        return {column for name in names if (column := schedule.column(str(name), minute)) is not None}


def _noted_minute(mark: Event) -> int:
    """The minute from which a mark counts."""
    return int(mark.data.get("noted_ns", mark.time_ns)) // MINUTE_NS


def _until(column: int, begin: Event, end_ns: int) -> ShadeTest:
    """A test that ends when the operator says so, at the latest after the longest time."""
    longest_ns = round(float(begin.data.get("for_s", SHADE_TEST_S)) * SECOND_NS)
    return ShadeTest(column, begin.time_ns, min(end_ns, begin.time_ns + longest_ns))


class ShadedMinutes:
    """Shaded minutes of each region, as known at the last one; the changes that each minute makes to them."""

    def __init__(self) -> None:
        self._slow: set[Cell] = set()
        self._flagged: set[Cell] = set()
        self._settled: set[Cell] = set()
        self._dismissed: set[Cell] = set()

    def update(
        self, minute: int, cells: set[Cell], slow: Iterable[int], marked: Iterable[ShadeTest]
    ) -> tuple[set[int], tuple[Cell, ...]]:
        """The columns shaded in a minute, and the earlier cells whose flag it reverses.

        `found` are all cells of shade tests, `slow` the columns that are otherwise shaded in this minute,
        `marked` those of the operator, whose end overrules what was found after it until then.
        """
        self._slow |= {(minute, column) for column in slow}
        shaded = cells | self._slow
        for test in marked:
            first, last = test.begin_ns // MINUTE_NS, (test.end_ns - 1) // MINUTE_NS
            if (last, test.column) not in self._settled:
                self._settled.add((last, test.column))
                self._dismissed |= {cell for cell in shaded if cell[1] == test.column and cell[0] > last}
            shaded = shaded | {(at, test.column) for at in range(first, min(last, minute) + 1)}
        shaded -= self._dismissed
        self._dismissed |= self._flagged - shaded  # for good: a flag is reversed once each way
        reversed_cells = tuple(sorted(cell for cell in shaded ^ self._flagged if cell[0] < minute))
        self._flagged = shaded
        return {column for at, column in shaded if at == minute}, reversed_cells
