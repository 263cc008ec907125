"""The regions of a campaign: add, edit and remove them in ``fieldkit.toml``, and check them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from fieldkit.config import Config, ConfigMistakesError, edit, read_config
from fieldkit.config.edit import Draft
from fieldkit.drivers import registry
from fieldkit.estimation.region_check import CameraView, RegionInspection, check_regions, pixel_noise_k
from fieldkit.model.arrays import FloatArray
from fieldkit.model.device import StreamInfo, cameras_by_name, find_camera
from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Sample, is_usable
from fieldkit.phrases import Words
from fieldkit.physics.camera_laws import frame_k, has_temperatures

AVERAGED_FRAMES = 25

Point = tuple[float, float]
Rect = tuple[float, float, float, float]


class RegionProperties(TypedDict, total=False):
    """What a region is for, and its known properties: slope, emissivity, the camera's offset there.

    `kind` is ``target``, ``reference``, ``blackbody`` or ``foil``, as in ``fieldkit.toml``. Emissivity and
    offset may name a calibration record: ``"@sand"``.
    """

    kind: str
    tilt_deg: float
    azimuth_deg: float
    emissivity: float | str
    offset_k: float | str


def add_region(
    draft: Draft,
    name: str,
    *,
    points: Sequence[Point] = (),
    rect: Rect | None = None,
    is_ground: bool = False,
    **properties: Unpack[RegionProperties],
) -> dict[str, Any]:
    """Add a region to a ``fieldkit.toml``; the ``[[region]]`` table that was written.

    Parameters
    ----------
    draft
        The campaign's ``fieldkit.toml``.
    name
        Letters, digits, ``-`` and ``_``.
    points
        Corners ``(x, y)`` in order around the region, at least three. [pixel]
    rect
        Instead of `points`: left, top, width, height. [pixel]
    is_ground
        Whether `points` are east, north on the ground of the campaign's ``camera.pose``. [m]
    **properties
        See `RegionProperties`; a target unless its kind is given.

    Raises
    ------
    ConfigError
        The region or the configuration with it would be invalid; nothing is written.
    """
    if (len(points) > 0) == (rect is not None):
        raise ConfigError(
            "a region needs its corners or a rectangle",
            place=name,
            fix="give " + Argument("points") + " or " + Argument("rect") + ", not both",
        )
    corners = points if rect is None else _corners(*rect)
    table = {
        "name": name,
        "kind": "target",
        "points_m" if is_ground else "points_px": written_points(corners),
        **properties,
    }
    edit.add_region(draft, table)
    return table


def edit_region(
    draft: Draft,
    name: str,
    *,
    points: Sequence[Point] = (),
    shrink_px: float | None = None,
    **properties: Unpack[RegionProperties],
) -> dict[str, Any]:
    """Change a region in a ``fieldkit.toml``: its corners, what it is for, its properties; the changed keys.

    `shrink_px` moves its edges inwards. Raises `ConfigError` if there is no such region, if nothing is to
    change, or if the result is invalid.
    """
    changes: dict[str, Any] = dict(properties)
    if points:
        changes["points_px"] = written_points(points)
    if shrink_px is not None:
        regions = {region.name: region for region in regions_in_draft(draft).regions}
        shrunk = regions[name].shrunk(shrink_px).points_px if name in regions else ()
        changes["points_px"] = written_points([(round(x, 1), round(y, 1)) for x, y in shrunk])
    if not changes:
        raise ConfigError(
            "nothing is to change", place=name, fix="give its corners, tilt, azimuth, emissivity or offset"
        )
    edit.change_region(draft, name, changes)
    return changes


def regions_in_draft(draft: Draft) -> Config:
    """The configuration of a draft with its regions; raises as `read_regions`."""
    return read_regions(draft.file, text=draft.text)[0]


def read_regions(
    file: Path, settings: Sequence[str] = (), *, text: str | None = None
) -> tuple[Config, list[str]]:
    """The configuration with its regions, and what is wrong with the regions, for those who mend them.

    Raises `ConfigMistakesError` if no configuration can be read at all.
    """
    config, mistakes = read_config(file, text=text, settings=settings)
    if config is None:
        raise ConfigMistakesError(mistakes, fix=f"edit {file}")
    return config, [mistake.message for _, mistake in mistakes if mistake.path[:1] == ("region",)]


def inspect_regions(config: Config, session: Path | None = None) -> list[RegionInspection]:
    """Check a campaign's regions, in the frames of a session or in a frame of the configured size.

    Raises `SessionError` if the session has no frames with temperatures.
    """
    if session is not None:
        cameras = {"", *(region.camera for region in config.regions)}
        views = {name: view_of_frames(config, first_frames_k(session, name)) for name in cameras}
        return check_regions(config.regions, views)
    camera, views = config.tables.camera, {}
    if camera and camera.height_px and camera.width_px:
        views[""] = _view(config, (camera.height_px, camera.width_px), camera.driver)
    return check_regions(config.regions, views)


def camera_views(config: Config, streams: Iterable[StreamInfo]) -> dict[str, CameraView]:
    """The view of each camera that is open by its name, with its driver's noise; of the first also by ""."""
    cameras = cameras_by_name(streams).items()
    return {name: _view(config, info.shape, info.driver) for name, info in cameras}


def _view(config: Config, shape: tuple[int, ...], driver: str) -> CameraView:
    """The view of a camera without frames, with its driver's noise."""
    return CameraView(shape, noise_k=minute_noise_k(config, registry.noise_k(driver)))


def view_of_frames(config: Config, frames: FloatArray) -> CameraView:
    """The mean of successive frames (n, rows, cols) of kelvin, with the noise that they have themselves."""
    return CameraView(frames.shape[1:], frames.mean(axis=0), minute_noise_k(config, pixel_noise_k(frames)))


def minute_noise_k(config: Config, noise_k: float) -> float:
    """Noise of the mean of a minute's frames of `noise_k`: those in bursts, else one a second."""
    record = config.tables.record
    frames = 60.0 * record.burst_frames / record.every_s if record.sampling == "bursts" else 60.0
    return noise_k / math.sqrt(max(1.0, frames))


def _corners(x: float, y: float, width: float, height: float) -> list[Point]:
    """The corner pixels of a rectangle `width` x `height` pixels large."""
    right, bottom = x + width - 1, y + height - 1
    return [(x, y), (right, y), (right, bottom), (x, bottom)]


def written_points(corners: Sequence[Sequence[float]]) -> list[list[int | float]]:
    """Corners as they stand in ``fieldkit.toml``."""
    return [[_short(x), _short(y)] for x, y in corners]


def _short(value: float) -> int | float:
    """A whole number without its decimal point, as people write pixels."""
    return int(value) if float(value).is_integer() else float(value)


def check_configured(config: Config, *, unless: Config) -> None:
    """Raise `ConfigError` for regions that cannot be used, apart from what is wrong in `unless` already."""
    before = _failures(unless)
    if failures := [failure for failure in _failures(config) if failure not in before]:
        raise ConfigError(Words("text.all", texts=failures), fix=Words("fix.draw_again"))


def _failures(config: Config) -> list[str]:
    return [failure for check in inspect_regions(config) for failure in check.named_failures]


def first_frames_k(path: Path, name: str = "") -> FloatArray:
    """The first good frames of a session's camera, by default the first, kelvin, (n, rows, cols).

    Raises `SessionError` if the session has no frames with a temperature.
    """
    from fieldkit.sessions.reader import open_session

    with open_session(path) as session:
        camera = find_camera(session.streams.values(), name)
        frames = _usable_frames_k(session.samples(camera.name), camera) if camera else iter(())
        first_frames = list(itertools.islice(frames, AVERAGED_FRAMES))
    if not first_frames:
        raise SessionError(Words("error.no_frame"), place=path, fix="omit " + Argument("session"))
    return np.array(first_frames, np.float64)


def _usable_frames_k(samples: Iterable[Sample], camera: StreamInfo) -> Iterator[FloatArray]:
    """The usable frames, as brightness temperatures."""
    if not has_temperatures(camera):
        return
    for sample in samples:
        if isinstance(sample, Frame) and is_usable(sample.quality):
            yield frame_k(camera, sample.counts, sample.metadata_rows)
