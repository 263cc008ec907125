"""When the weather changes: the light meter at once, the reference's temperature to confirm.

`LightWatch` looks at every reading of the light: a change by more than 15 % within two
minutes is faster than the sun can move. `Cusum` is E. S. Page's cumulative sum
("Continuous inspection schemes", Biometrika 1954) on one-step predictions of a temperature;
it needs no light meter, and on one bed alone it tells a shadow.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

SUDDEN_CHANGE = 0.15
SUDDEN_S = 120.0
STEADY_CHANGE = 0.05
STEADY_S = 60.0
NEW_WEATHER_S = 1200.0
MIN_VALUES = 10
STRETCH_NS = 5 * 10**9
GUST_SD_K = 0.2
"""What gusts do to a bed's temperature from minute to minute outdoors: smaller jumps are no weather."""


@dataclass(frozen=True, slots=True)
class LightChange:
    """The light became unsteady (`begin`) or steady again (`end`), and why, in words."""

    kind: Literal["begin", "end"]
    mono_ns: int
    time_ns: int
    text: str


class LightWatch:
    """Tells clouds from a stream of light readings in order of time.

    Each reading is divided by what the sun's height alone would make of it. A change of
    15 % within two minutes begins a cloud. It ends when the light has been steady (5 %) for
    one minute near its old level, or for 20 minutes at a new one: then that is the weather.
    """

    def __init__(self) -> None:
        self._recent: deque[tuple[int, float, float]] = deque()
        self._level = float("nan")
        self._steady_since = 0
        self._steady_at = float("nan")
        self.cloudy = False

    def add(self, mono_ns: int, time_ns: int, clearness: float) -> LightChange | None:
        """Look at one reading over its clear expectation, any unit, positive; NaN is passed over."""
        if not np.isfinite(clearness) or clearness <= 0.0:
            return None
        self._remember(time_ns // STRETCH_NS, clearness)
        if self.cloudy:
            return self._ending(mono_ns, time_ns, clearness)
        lowest = min(low for _, low, _ in self._recent)
        highest = max(high for _, _, high in self._recent)
        change = max(clearness / highest - 1.0, clearness / lowest - 1.0, key=abs)
        if abs(change) <= SUDDEN_CHANGE:
            return None
        self.cloudy = True
        self._level = highest if change < 0 else lowest
        self._steady_since, self._steady_at = time_ns, clearness
        return LightChange("begin", mono_ns, time_ns, f"light changed by {change:+.0%} within 2 min")

    def _remember(self, stretch: int, clearness: float) -> None:
        """Keep the lowest and highest of every 5 s, so that a fast meter costs no more than a slow one."""
        while self._recent and (stretch - self._recent[0][0]) * STRETCH_NS > SUDDEN_S * 1e9:
            self._recent.popleft()
        if self._recent and self._recent[-1][0] == stretch:
            _, low, high = self._recent.pop()
            self._recent.append((stretch, min(low, clearness), max(high, clearness)))
        else:
            self._recent.append((stretch, clearness, clearness))

    def _ending(self, mono_ns: int, time_ns: int, clearness: float) -> LightChange | None:
        if abs(clearness / self._steady_at - 1.0) > STEADY_CHANGE:
            self._steady_since, self._steady_at = time_ns, clearness
            return None
        steady_s = (time_ns - self._steady_since) / 1e9
        back = abs(clearness / self._level - 1.0) <= SUDDEN_CHANGE
        if steady_s < (STEADY_S if back else NEW_WEATHER_S):
            return None
        self.cloudy = False
        self._recent.clear()
        text = "light is back" if back else f"light steady at {clearness / self._level:.0%} of what it was"
        return LightChange("end", mono_ns, time_ns, text)


@dataclass(frozen=True, slots=True)
class Jump:
    """A value that left its forecast: what was expected, what came, and by how many standard deviations."""

    expected: float
    found: float
    score: float


@dataclass(slots=True)
class Cusum:
    """Two-sided cumulative sum on the residuals of a quadratic forecast of one-minute values.

    `slack` and `limit` are in standard deviations (Page's k and h); with a limit of 8 seven
    clear hours give no false alarm. The forecast runs through the last `memory` minutes, and
    its residual is scaled by the scatter of the past ones, never below `least_sd`.
    """

    slack: float = 0.5
    limit: float = 8.0
    memory: int = 30
    least_sd: float = 0.03
    high: float = 0.0
    low: float = 0.0
    _values: deque[tuple[float, float]] = field(default_factory=deque)
    _errors: deque[float] = field(default_factory=deque)

    def add(self, minute: int, value: float) -> Jump | None:
        """Take the value of a minute; a `Jump` on alarm. NaN is passed over.

        After an alarm the past is forgotten: new weather is not forecast from the old.
        """
        if not np.isfinite(value):
            return None
        while self._values and minute - self._values[0][0] > self.memory:
            self._values.popleft()
        jump = None
        if len(self._values) >= MIN_VALUES:
            expected, leverage = _forecast(self._values, minute)
            score = self._accumulate((value - expected) / np.sqrt(1.0 + leverage))
            jump = Jump(expected, value, score) if score else None
        if jump is not None:
            self._values.clear()
            self._errors.clear()
        self._values.append((minute, value))
        return jump

    def _accumulate(self, error: float) -> float:
        """The score when the sums pass the limit, else 0."""
        scatter = float(np.std(self._errors)) if len(self._errors) >= MIN_VALUES else 0.0
        score = error / max(self.least_sd, scatter)
        self._errors.append(error)
        if len(self._errors) > self.memory:
            self._errors.popleft()
        self.high = max(0.0, self.high + score - self.slack)
        self.low = max(0.0, self.low - score - self.slack)
        if max(self.high, self.low) <= self.limit:
            return 0.0
        self.high = self.low = 0.0
        return score


def _forecast(values: Sequence[tuple[float, float]], minute: int) -> tuple[float, float]:
    """Quadratic forecast for a minute, and its own variance relative to the noise."""
    past = np.array(values)
    design = np.vander((past[:, 0] - minute) / 30.0, 3)
    inverse = np.linalg.inv(design.T @ design)
    return float((inverse @ design.T @ past[:, 1])[2]), float(inverse[2, 2])


class ShadeWatch:
    """Tells when one bed alone loses its sun: its temperature over the reference's falls off the forecast.

    It is lit again when half the fall is made good; after 20 minutes the new level is
    taken for what it is.
    """

    def __init__(self) -> None:
        self._cusum = Cusum(least_sd=GUST_SD_K)
        self._fall: Jump | None = None
        self._since = 0

    def add(self, minute: int, over_reference_k: float) -> bool:
        """Whether the bed is in shade in this minute."""
        jump = self._cusum.add(minute, over_reference_k)
        if self._fall is None:
            if jump is not None and jump.found < jump.expected:
                self._fall, self._since = jump, minute
            return self._fall is not None
        half = 0.5 * (self._fall.expected + self._fall.found)
        if over_reference_k > half or (minute - self._since) * 60.0 >= NEW_WEATHER_S:
            # the shade is no past to forecast the light from
            self._fall, self._cusum = None, Cusum(least_sd=GUST_SD_K)
        return self._fall is not None
