"""Offsets of regions against the reference, from recordings of a uniform target before and after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack

import numpy as np

from fieldkit.calibrate.result import Calibration, make_record
from fieldkit.calibration import uniformity as offsets
from fieldkit.calibration.calibration_record import Instrument, instrument_of
from fieldkit.calibration.ranges import require_ranges
from fieldkit.calibration.uncertainty import students_factor
from fieldkit.calibration.uniformity import TargetView, Uniformity
from fieldkit.estimation.scale import offsets_from_uniform
from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import is_usable
from fieldkit.model.site import RegionKind
from fieldkit.results.sources import SessionOrFile, config_for, log_warning, notify_damage, reading
from fieldkit.sessions.analysis import region_series
from fieldkit.sessions.reader import SessionReader

BLOCK_NS = 10_000_000_000
"""Frames of ten seconds count as one, because errors of neighbouring frames are correlated."""
LEAST_BLOCKS = 3


def uniformity(
    before: SessionOrFile,
    after: SessionOrFile | None = None,
    *,
    name: str = "uniformity",
    target_sd_k: float = 0.05,
    notify: Callable[[str], None] = log_warning,
) -> Calibration:
    """Find the offsets of all regions against the reference.

    Parameters
    ----------
    before, after : Session or path
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
        Without a reference region and other regions, or if two cameras recorded the target.
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
    with ExitStack() as stack:
        sources = [before] if after is None else [before, after]
        sessions = [stack.enter_context(reading(source)) for source in sources]
        return _of_sessions(sorted(sessions, key=lambda session: session.end_ns), name, target_sd_k, notify)


def _of_sessions(
    sessions: Sequence[SessionReader], name: str, target_sd_k: float, notify: Callable[[str], None]
) -> Calibration:
    """The offsets from one session or two, in order of time."""
    views = []
    for session in sessions:
        views.append(target_view(session))
        notify_damage(session, notify)
    result = offsets.uniformity(*views, target_sd_k=target_sd_k)
    sds = {region: result.standard_uncertainty_k(region) for region in result.offset_k}
    record = make_record(
        "uniformity",
        name,
        max(result.offset_k.values(), key=abs),
        "K",
        result.budget[result.worst],
        sessions,
        method="uniform target over all regions" + (", before and after" if len(sessions) == 2 else ""),
        values=dict(result.offset_k),
        uncertainties=sds,
        instrument=_one_camera(sessions),
        details={"drift_k_per_h": dict(result.drift_k_per_h)},
        settings={"name": name, "target_sd": target_sd_k},
    )
    used_by = f'offset_k = "@{name}" in each [[region]]'
    summary = _summary(result, with_drift=len(sessions) == 2)
    return Calibration(record, summary, used_by, config_for(sessions[-1]).calibration)


def _one_camera(sessions: Sequence[SessionReader]) -> Instrument:
    """The camera of all sessions; raises `ConfigError` for two."""
    cameras = [
        instrument_of(next(info for info in session.streams.values() if info.is_camera))
        for session in sessions
    ]
    if cameras[0] != cameras[-1]:
        first, second = (
            f"{camera.model} {camera.serial_number} {camera.range}".strip() for camera in cameras
        )
        raise ConfigError(
            f"of the camera {second}, but {sessions[0].path.name} of {first}",
            place=sessions[1].path,
            fix="take both views with one camera in one range",
        )
    return cameras[0]


def target_view(session: SessionReader) -> TargetView:
    """Offsets during a recording of one uniform target.

    Raises `ConfigError` without a reference, `CalibrationError` if the recording is too short.
    """
    series = region_series(session)
    kinds = {region.name: region.kind for region in session.regions}
    is_reference = np.array([kinds[name] is RegionKind.REFERENCE for name in series.regions])
    if not is_reference.any() or is_reference.all():
        raise ConfigError("needs a reference and other regions", place=session.path, fix=Action.ADD_REGION())
    good = is_usable(series.flags)
    blocks, place = np.unique(series.time_ns[good] // BLOCK_NS, return_inverse=True)
    if blocks.size < LEAST_BLOCKS:
        raise CalibrationError(
            f"has {good.sum()} good frames: too few",
            place=session.path,
            fix="record a minute or more of the target",
        )
    counts = np.bincount(place)[:, np.newaxis]
    means = np.array([np.bincount(place, column) for column in series.mean_k[good].T]).T / counts
    reference, targets = means[:, is_reference].mean(axis=1), means[:, ~is_reference]
    region_offsets = offsets_from_uniform(targets, reference)
    offset_sd_k = students_factor(blocks.size - 1) * region_offsets.offset_sd_k
    names = [name for name, reference in zip(series.regions, is_reference, strict=True) if not reference]
    return TargetView(
        int(series.time_ns[good].mean()),
        dict(zip(names, region_offsets.offset_k.tolist(), strict=True)),
        dict(zip(names, offset_sd_k.tolist(), strict=True)),
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
