"""From hours of camera and thermometer readings to steady pairs, with checks of their pairing.

A surface and a probe in it are compared only while both are steady: intervals of a minute or more in which
the probe drifts by less than 0.1 K per minute, at most five minutes each. Medians of the probe, means of the
camera. Before that the whole time series are compared, which reveals an offset between the clocks of two
logs, or a probe in another bed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fieldkit.calibration.emissivity import Pairs
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.errors import CalibrationError
from fieldkit.model.next_step import Argument

STEADY_K_MIN = 0.1
BLOCK_S, MAX_BLOCKS = 60.0, 5
CAMERA_NOISE_K, PLACEMENT_K = 0.05, 0.15
"""Least uncertainty of each pair: noise of a region's mean, and placement of the probe."""
MAX_LAG_S, LAG_STEP_S, SIGNIFICANT_LAG_S = 1800.0, 15.0, 90.0
BETTER_LAG, BETTER_PROBE = 2.0, 1.3
"""Factor by which another shift, or another probe, must fit better to be accepted."""
MIN_VARIATION_K = 1.0


@dataclass(frozen=True, slots=True)
class Readings:
    """Camera readings at times (n,): region and reflector; probe readings at times (m,). Kelvin, UTC ns."""

    camera_ns: IntArray
    apparent_k: FloatArray
    reflected_k: FloatArray
    contact_ns: IntArray
    contact_k: FloatArray


@dataclass(frozen=True, slots=True)
class SteadyInterval:
    """Consecutive steady minutes: means and standard uncertainties in kelvin, drifts in kelvin per minute."""

    start_ns: int
    end_ns: int
    apparent_k: float
    contact_k: float
    reflected_k: float
    apparent_sd_k: float
    contact_sd_k: float
    contact_drift_k_min: float
    apparent_drift_k_min: float

    @property
    def agrees(self) -> bool:
        """True if the camera also finds the surface steady."""
        return not abs(self.apparent_drift_k_min) > 3.0 * STEADY_K_MIN


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Minutes that have frames and probe readings, side by side (b,)."""

    start_ns: IntArray
    apparent_k: FloatArray
    reflected_k: FloatArray
    contact_k: FloatArray
    contact_drift_k_min: FloatArray

    def __len__(self) -> int:
        return self.start_ns.size


def steady_intervals(readings: Readings) -> list[SteadyInterval]:
    """Every interval in which the probe was steady, in order of time."""
    blocks = _blocks(readings)
    return [_interval(blocks, rows) for rows in _runs(blocks)]


def pairs_of(intervals: list[SteadyInterval]) -> tuple[Pairs, tuple[str, ...]]:
    """Pairs of the intervals that camera and probe agree on, and notes on the others."""
    good = [interval for interval in intervals if interval.agrees]
    remarks = []
    if len(good) < len(intervals):
        count = len(intervals) - len(good)
        remarks.append(f"{count} intervals excluded: the probe was steady, the surface in the frame was not")
    columns = [(s.apparent_k, s.contact_k, s.reflected_k, s.apparent_sd_k, s.contact_sd_k) for s in good]
    pairs = Pairs(*np.array(columns, np.float64).reshape(-1, 5).T)
    if len(good) >= 2 and pairs.span_k < 5.0:
        remarks.append(
            f"the surface spans only {pairs.span_k:.1f} K; three temperatures 5 K apart determine it better"
        )
    return pairs, tuple(remarks)


def drift_k_min(time_ns: IntArray, value_k: FloatArray) -> float:
    """Drift in K/min by a straight line through temperatures (n,), NaN where unknown.

    At UTC nanoseconds (n,); NaN for fewer than three values, or where all are of one instant.
    """
    has_value = np.isfinite(value_k)
    if has_value.sum() < 3:
        return float("nan")
    minutes = (time_ns[has_value] - time_ns[0]) / 60e9
    centred = minutes - minutes.mean()
    spread = float(centred @ centred)
    return float(centred @ value_k[has_value]) / spread if spread else float("nan")


def refuse_shifted_clocks(readings: Readings) -> None:
    """Raise `CalibrationError` if the probe's series fits the camera's much better at another time."""
    lag_s = best_lag_s(readings)
    if lag_s is not None and abs(lag_s) > SIGNIFICANT_LAG_S:
        raise CalibrationError(
            f"the thermometer's readings fit the camera's best when shifted by {lag_s / 60.0:+.1f} min",
            fix=f"compare the clocks of the two logs: import the thermometer again, {lag_s:+.0f} s added to "
            "its times; or, of one recording, the probe follows late: less sand over it, a thinner wire",
        )


def best_lag_s(readings: Readings) -> float | None:
    """Seconds to add to the probe's times so that it fits the camera best.

    Shifts of up to 30 minutes either way are tried, or a third of the time span. 0 where no shift is twice as
    good, None if undetermined.
    """
    apparent_k = readings.apparent_k[np.isfinite(readings.apparent_k)]
    if apparent_k.size == 0 or np.ptp(apparent_k) < MIN_VARIATION_K:
        return None
    span_s = float(readings.contact_ns[-1] - readings.contact_ns[0]) / 1e9
    steps = int(min(MAX_LAG_S, span_s / 3.0) // LAG_STEP_S)
    lags = LAG_STEP_S * np.arange(-steps, steps + 1)
    misfits = np.array([_misfit(readings, readings.contact_k, float(lag), float(lags[-1])) for lag in lags])
    if not np.isfinite(misfits).all():
        return None
    return 0.0 if misfits[steps] <= BETTER_LAG * misfits.min() else float(lags[np.argmin(misfits)])


def refuse_other_bed(readings: Readings, others_k: Mapping[str, FloatArray], chosen: str) -> None:
    """Raise `CalibrationError` if another probe, read at the same times, follows the region much better.

    Beds within about ten degrees of each other are too similar for that.
    """
    own = _misfit(readings, readings.contact_k)
    misfits = {name: _misfit(readings, values) for name, values in others_k.items()}
    misfits = {name: misfit for name, misfit in misfits.items() if np.isfinite(misfit)}
    best = min(misfits, key=misfits.__getitem__, default=chosen)
    if misfits and own > 2.0 * CAMERA_NOISE_K and BETTER_PROBE * misfits[best] < own:
        raise CalibrationError(
            f"the region follows the probe {best} instead: is it on another bed?",
            place=chosen,
            fix=f"choose the region that {chosen} lies in, or " + Argument("channel", best),
        )


def _misfit(readings: Readings, contact_k: FloatArray, lag_s: float = 0.0, margin_s: float = 0.0) -> float:
    """RMS residual of a straight line from the probe, `lag_s` later, to the camera, kelvin.

    Frames within `margin_s` of the probe's ends are excluded, so that every lag is judged by the same
    frames.
    """
    has_contact, is_apparent = np.isfinite(contact_k), np.isfinite(readings.apparent_k)
    if not has_contact.any():
        return float("nan")
    origin = readings.contact_ns[0]
    probe_s, camera_s = (
        (times - origin) / 1e9 for times in (readings.contact_ns[has_contact], readings.camera_ns)
    )
    inside = is_apparent & (camera_s >= probe_s[0] + margin_s) & (camera_s <= probe_s[-1] - margin_s)
    if inside.sum() < 10:
        return float("nan")
    x, y = np.interp(camera_s[inside], probe_s + lag_s, contact_k[has_contact]), readings.apparent_k[inside]
    centred = x - x.mean()
    slope = float(centred @ y) / max(float(centred @ centred), 1e-12)
    return float(np.std(y - slope * centred))


def _blocks(readings: Readings) -> _Blocks:
    block_ns = round(BLOCK_S * 1e9)
    numbers = np.unique(readings.camera_ns // block_ns)
    rows = []
    for number in numbers:
        start, end = int(number) * block_ns, (int(number) + 1) * block_ns
        in_view = _within(readings.camera_ns, start, end)
        in_contact = _within(readings.contact_ns, start, end)
        near = _within(readings.contact_ns, start - block_ns // 2, end + block_ns // 2)
        contact, apparent = readings.contact_k[in_contact], readings.apparent_k[in_view]
        contact = contact[np.isfinite(contact)]
        if contact.size and np.isfinite(apparent).any():
            drift = drift_k_min(readings.contact_ns[near], readings.contact_k[near])
            mirrored = _mean(readings.reflected_k[in_view])
            rows.append((start, _mean(apparent), mirrored, float(np.median(contact)), drift))
    table = np.array([row[1:] for row in rows], np.float64).reshape(-1, 4).T
    return _Blocks(np.array([row[0] for row in rows], np.int64), *table)


def _within(time_ns: IntArray, start_ns: int, end_ns: int) -> slice:
    """Rows of sorted times within a range."""
    first, last = np.searchsorted(time_ns, [start_ns, end_ns])
    return slice(int(first), int(last))


def _mean(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")


def _runs(blocks: _Blocks) -> Iterator[IntArray]:
    """Rows of consecutive steady minutes, five at most."""
    steady = np.abs(blocks.contact_drift_k_min) < STEADY_K_MIN
    run: list[int] = []
    for row in range(len(blocks)):
        follows = bool(run) and blocks.start_ns[row] - blocks.start_ns[run[-1]] <= 1.5 * BLOCK_S * 1e9
        if run and not (steady[row] and follows and len(run) < MAX_BLOCKS):
            yield np.array(run)
            run = []
        if steady[row]:
            run.append(row)
    if run:
        yield np.array(run)


def _interval(blocks: _Blocks, rows: IntArray) -> SteadyInterval:
    around = slice(max(0, rows[0] - 2), rows[-1] + 3)
    apparent, contact = blocks.apparent_k[rows], blocks.contact_k[rows]
    return SteadyInterval(
        start_ns=int(blocks.start_ns[rows[0]]),
        end_ns=int(blocks.start_ns[rows[-1]]) + round(BLOCK_S * 1e9),
        apparent_k=float(apparent.mean()),
        contact_k=float(np.median(contact)),
        reflected_k=_mean(blocks.reflected_k[rows]),
        apparent_sd_k=max(CAMERA_NOISE_K, _scatter(apparent)),
        contact_sd_k=float(np.hypot(PLACEMENT_K, _scatter(contact))),
        contact_drift_k_min=float(np.mean(blocks.contact_drift_k_min[rows])),
        apparent_drift_k_min=drift_k_min(blocks.start_ns[around], blocks.apparent_k[around]),
    )


def _scatter(values: FloatArray) -> float:
    """Standard error of the mean of values after removing their trend."""
    if values.size < 4:
        return 0.0
    at = np.arange(values.size)
    residuals = values - np.polyval(np.polyfit(at, values, 1), at)
    return float(np.sqrt(residuals @ residuals / (values.size - 2) / values.size))
