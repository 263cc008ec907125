"""Error statistics of estimates against the truth, as in the paper's section 5: pure functions.

Absolute errors are of tilt, in degrees, unless stated otherwise. Pairs with a NaN on either side are
excluded; without any pair the result is NaN, not zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from fieldkit.model.arrays import FloatArray

SdKind = Literal["paper", "usual"]
"""The standard deviation of eq. (9) as printed, or the ordinary one."""


def differences(estimated: ArrayLike, truth: ArrayLike) -> FloatArray:
    """Estimated minus true values where both are known, shape (k,), k <= n."""
    difference = np.asarray(estimated, np.float64) - np.asarray(truth, np.float64)
    return difference[np.isfinite(difference)]


def mean_absolute_error(estimated: ArrayLike, truth: ArrayLike) -> float:
    """MAE of eq. (8), in the unit of its arguments."""
    difference = differences(estimated, truth)
    return float(np.mean(np.abs(difference))) if difference.size else float("nan")


def root_mean_square_error(estimated: ArrayLike, truth: ArrayLike) -> float:
    """RMSE, the figure the paper gives for its energy model (1.83 K), in the unit of its arguments."""
    difference = differences(estimated, truth)
    return float(np.sqrt(np.mean(difference**2))) if difference.size else float("nan")


def sd_of_absolute_error(estimated: ArrayLike, truth: ArrayLike, kind: SdKind = "paper") -> float:
    """Scatter of the absolute error about its mean, in the unit of its arguments.

    ``"paper"`` is eq. (9) as printed, ``sqrt(sum of squares) / n``: with n outside the root
    it is the standard error of the mean (up to n against n - 1). ``"usual"`` has n inside,
    ``sqrt(sum of squares / n)``, which is larger by ``sqrt(n)``.
    """
    absolute = np.abs(differences(estimated, truth))
    if not absolute.size:
        return float("nan")
    squares = float(np.sum((absolute - np.mean(absolute)) ** 2))
    return float(np.sqrt(squares) / absolute.size if kind == "paper" else np.sqrt(squares / absolute.size))


@dataclass(frozen=True, slots=True)
class ErrorSpan:
    """Absolute errors of the estimates between two times: their mean, scatter and number."""

    start_ns: int
    end_ns: int
    mean: float
    sd: float
    count: int

    @property
    def middle_ns(self) -> int:
        """Middle of the span, for a plot."""
        return (self.start_ns + self.end_ns) // 2


def errors_over_time(
    time_ns: ArrayLike, estimated: ArrayLike, truth: float, *, span_s: float = 1200.0, kind: SdKind = "paper"
) -> list[ErrorSpan]:
    """Mean absolute error and its scatter per span of time, as in the paper's Fig. 13.

    Spans of `span_s` start at whole multiples of it; `time_ns` may be since 1970 or, to lay
    several days over each other, since midnight. Spans without an estimate are omitted.
    """
    times, values = np.asarray(time_ns, np.int64), np.asarray(estimated, np.float64)
    is_finite = np.isfinite(values)
    times, values = times[is_finite], values[is_finite]
    span_ns = round(span_s * 1e9)
    spans = []
    for start in np.unique(times // span_ns) * span_ns:
        inside = values[(times >= start) & (times < start + span_ns)]
        mean = mean_absolute_error(inside, truth)
        sd = sd_of_absolute_error(inside, truth, kind)
        spans.append(ErrorSpan(int(start), int(start) + span_ns, mean, sd, inside.size))
    return spans
