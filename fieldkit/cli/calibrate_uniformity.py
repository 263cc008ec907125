"""``fieldkit calibrate uniformity``: offsets between regions from a uniform target, before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray

from fieldkit.cli import common
from fieldkit.cli.session_paths import find_session
from fieldkit.cli.types import RECORD_NAME
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.units import SECOND_NS

if TYPE_CHECKING:
    from fieldkit.calibration.uniformity import TargetView
    from fieldkit.sessions.reader import Session

BLOCK_NS = 10 * SECOND_NS
"""Pictures of ten seconds count as one: neighbours err alike."""
LEAST_BLOCKS = 3


@click.command(cls=common.Command)
@click.argument("before", type=click.Path(path_type=Path))
@click.argument("after", required=False, type=click.Path(path_type=Path))
@click.option("--name", type=RECORD_NAME, default="uniformity", show_default=True, help="Names the record.")
@click.option(
    "--target-sd",
    type=click.FloatRange(0),
    default=0.05,
    show_default=True,
    metavar="K",
    help="How uniform the target itself was.",
)
@click.pass_context
def command(ctx: click.Context, /, before: Path, after: Path | None, name: str, target_sd: float) -> None:
    r"""Offsets of all regions against the reference.

    BEFORE and AFTER are recordings of a minute or more with one board over all regions.

    \b
    fieldkit record --for 2m --name board && fieldkit calibrate uniformity recordings/*board.h5
    """
    from fieldkit.calibration.calibration_record import CalibrationRecord, instrument_of
    from fieldkit.calibration.uniformity import uniformity
    from fieldkit.cli.calibrating import finish, moment, source_of
    from fieldkit.sessions.reader import open_session
    from fieldkit.workflows.sources import config_for

    paths = [find_session(ctx, path) for path in (before, after) if path is not None]
    looks = []
    for path in paths:
        with open_session(path) as session:
            looks.append(look_of(session))
            common.say_damage(session)
            config, date = config_for(session), moment(session)
            camera = next(info for info in session.streams.values() if info.is_camera)
    found = uniformity(*looks, target_sd_k=target_sd)
    worst = found.worst
    sds = {region: found.standard_uncertainty_k(region) for region in found.offset_k}
    record = CalibrationRecord(
        "uniformity", name, date, max(found.offset_k.values(), key=abs), sds[worst], "K",
        "uniform target over all regions" + (", before and after" if after else ""),
        budget=found.budget[worst], values=dict(found.offset_k), uncertainties=sds,
        instrument=instrument_of(camera), sources=tuple(source_of(path) for path in paths),
        details={"drift_k_per_h": dict(found.drift_k_per_h)},
        settings={"name": name, "target_sd": target_sd},
    )  # fmt: skip
    told = "   ".join(
        f"{region} {offset:+.2f} ± {2 * sds[region]:.2f} K" for region, offset in found.offset_k.items()
    )
    drift = "   ".join(f"{region} {value:+.2f}" for region, value in found.drift_k_per_h.items())
    headline = f"bias relative to the reference (k=2):  {told}" + (
        f"\ndrift, K per hour:  {drift}" if after else ""
    )
    finish(record, config, headline, f'offset_k = "@{name}" in each [[region]]')


def look_of(session: Session) -> TargetView:
    """Offsets while a session's pictures show one uniform target.

    Raises `ConfigError` without a reference, `CalibrationError` if it is too short.
    """
    from fieldkit.calibration.uniformity import TargetView
    from fieldkit.estimation.scale import offsets_from_uniform
    from fieldkit.model.samples import is_usable
    from fieldkit.model.site import RegionKind
    from fieldkit.sessions.analysis import region_series

    series = region_series(session)
    kinds = {region.name: region.kind for region in session.regions}
    is_reference = np.array([kinds[name] is RegionKind.REFERENCE for name in series.regions])
    if not is_reference.any() or is_reference.all():
        raise ConfigError(f"{session.path} needs a reference and other regions", fix="fieldkit roi add")
    good = is_usable(series.flags)
    blocks, place = np.unique(series.time_ns[good] // BLOCK_NS, return_inverse=True)
    if blocks.size < LEAST_BLOCKS:
        raise CalibrationError(
            f"{session.path} has {good.sum()} good pictures: too few",
            fix="record a minute or more of the target",
        )
    counts = np.bincount(place)[:, np.newaxis]
    means = np.array([np.bincount(place, column) for column in series.mean_k[good].T]).T / counts
    reference = means[:, is_reference].mean(axis=1)
    targets = means[:, ~is_reference]
    found = offsets_from_uniform(targets, reference)
    names = [name for name, reference in zip(series.regions, is_reference, strict=True) if not reference]
    return TargetView(
        int(series.time_ns[good].mean()),
        dict(zip(names, found.offset_k.tolist(), strict=True)),
        dict(zip(names, found.offset_sd_k.tolist(), strict=True)),
        _change_k(targets - reference[:, np.newaxis]),
    )


def _change_k(difference_k: NDArray[np.float64]) -> float:
    """How far a region's difference (n, m) moved from the first third to the last."""
    third = max(1, len(difference_k) // 3)
    return float(np.abs(difference_k[-third:].mean(axis=0) - difference_k[:third].mean(axis=0)).max())
