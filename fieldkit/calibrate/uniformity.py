"""Offsets of regions against the reference, from recordings of a uniform target before and after."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldkit.calibrate.inputs import end_of, record_source
from fieldkit.calibrate.result import Calibration, stamped
from fieldkit.calibration import uniformity as offsets
from fieldkit.calibration.calibration_record import CalibrationRecord, instrument_of
from fieldkit.calibration.ranges import require_ranges
from fieldkit.calibration.uniformity import TargetView, Uniformity
from fieldkit.estimation.scale import offsets_from_uniform
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.samples import is_usable
from fieldkit.model.site import RegionKind
from fieldkit.physics.facet import FloatArray
from fieldkit.results.sources import config_for, log_warning, notify_damage
from fieldkit.sessions.analysis import region_series
from fieldkit.sessions.reader import SessionReader

BLOCK_NS = 10_000_000_000
"""Frames of ten seconds count as one, because errors of neighbouring frames are correlated."""
LEAST_BLOCKS = 3


def uniformity(
    before: SessionReader,
    after: SessionReader | None = None,
    *,
    name: str = "uniformity",
    target_sd_k: float = 0.05,
    notify: Callable[[str], None] = log_warning,
) -> Calibration:
    """Find the offsets of all regions against the reference.

    Parameters
    ----------
    before, after : Session
        Recordings of a minute or more with one board over all regions; `after` is optional and bounds
        the drift.
    name : str
        Names the record.
    target_sd_k : float
        Standard uncertainty of the target's uniformity. [K]
    notify : callable
        Receives warnings, such as damaged samples that were excluded.

    Raises
    ------
    ConfigError
        Without a reference region and other regions.
    CalibrationError
        If a recording is too short, or the regions did not see one uniform target.

    Examples
    --------
    Beds that all lie flat stand for the board here:

    >>> board = fieldkit.simulate("board", beds={"b05": (0, 180), "b15": (0, 180)}, duration="8m")
    >>> fieldkit.calibrate.uniformity(board)
    <Calibration: bias relative to the reference (k=2):  b05 -0.03 ± 0.10 K   b15 +0.04 ± 0.10 K>
    """
    require_ranges({"target_sd_k": target_sd_k})
    sessions = [before] if after is None else [before, after]
    views = []
    for session in sessions:
        views.append(target_view(session))
        notify_damage(session, notify)
    found = offsets.uniformity(*views, target_sd_k=target_sd_k)
    last, worst = sessions[-1], found.worst
    sds = {region: found.standard_uncertainty_k(region) for region in found.offset_k}
    record = CalibrationRecord(
        "uniformity",
        name,
        end_of(last),
        max(found.offset_k.values(), key=abs),
        sds[worst],
        "K",
        "uniform target over all regions" + (", before and after" if after else ""),
        budget=found.budget[worst],
        values=dict(found.offset_k),
        uncertainties=sds,
        instrument=instrument_of(next(info for info in last.streams.values() if info.is_camera)),
        sources=tuple(record_source(session.path) for session in sessions),
        details={"drift_k_per_h": dict(found.drift_k_per_h)},
        settings={"name": name, "target_sd": target_sd_k},
    )
    used_by = f'offset_k = "@{name}" in each [[region]]'
    summary = _summary(found, with_drift=after is not None)
    return Calibration(stamped(record), summary, used_by, config_for(last).calibration)


def target_view(session: SessionReader) -> TargetView:
    """Offsets during a recording of one uniform target.

    Raises `ConfigError` without a reference, `CalibrationError` if the recording is too short.
    """
    series = region_series(session)
    kinds = {region.name: region.kind for region in session.regions}
    is_reference = np.array([kinds[name] is RegionKind.REFERENCE for name in series.regions])
    if not is_reference.any() or is_reference.all():
        raise ConfigError(f"{session.path} needs a reference and other regions", fix="fieldkit roi add")
    good = is_usable(series.flags)
    blocks, place = np.unique(series.time_ns[good] // BLOCK_NS, return_inverse=True)
    if blocks.size < LEAST_BLOCKS:
        raise CalibrationError(
            f"{session.path} has {good.sum()} good frames: too few",
            fix="record a minute or more of the target",
        )
    counts = np.bincount(place)[:, np.newaxis]
    means = np.array([np.bincount(place, column) for column in series.mean_k[good].T]).T / counts
    reference, targets = means[:, is_reference].mean(axis=1), means[:, ~is_reference]
    found = offsets_from_uniform(targets, reference)
    names = [name for name, reference in zip(series.regions, is_reference, strict=True) if not reference]
    return TargetView(
        int(series.time_ns[good].mean()),
        dict(zip(names, found.offset_k.tolist(), strict=True)),
        dict(zip(names, found.offset_sd_k.tolist(), strict=True)),
        _largest_change_k(targets - reference[:, np.newaxis]),
    )


def _largest_change_k(difference_k: FloatArray) -> float:
    """Largest change of a region's difference (n, m) from the first third to the last."""
    third = max(1, len(difference_k) // 3)
    return float(np.abs(difference_k[-third:].mean(axis=0) - difference_k[:third].mean(axis=0)).max())


def _summary(found: Uniformity, *, with_drift: bool) -> str:
    each = "   ".join(
        f"{region} {offset:+.2f} ± {2 * found.standard_uncertainty_k(region):.2f} K"
        for region, offset in found.offset_k.items()
    )
    text = f"bias relative to the reference (k=2):  {each}"
    if with_drift:
        drift = "   ".join(f"{region} {value:+.2f}" for region, value in found.drift_k_per_h.items())
        text += f"\ndrift, K per hour:  {drift}"
    return text
