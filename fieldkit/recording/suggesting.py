"""Regions suggested for a campaign: beds found in a frame of its camera, with names and roles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldkit.config import Config
from fieldkit.config.edit import Draft
from fieldkit.estimation.region_suggestions import FIX, FoundBed, find_beds
from fieldkit.model.arrays import FloatArray
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.next_step import Action
from fieldkit.model.site import Region, RegionKind
from fieldkit.phrases import Words
from fieldkit.physics.camera_laws import frame_k, has_temperatures
from fieldkit.recording.opening import open_instruments
from fieldkit.recording.preview import usable_frame
from fieldkit.recording.record import config_of
from fieldkit.recording.regions import add_region, first_frames_k, view_of_frames
from fieldkit.recording.running import session_in_progress

if TYPE_CHECKING:
    from fieldkit.recording.campaign import Campaign

FRAMES = 9
"""Of a camera without a recording: a second, in which noise falls to a third."""


@dataclass(frozen=True, slots=True)
class SuggestedRegion:
    """A region to accept or not; `area` has its contrast, spread and number of pixels."""

    region: Region
    area: FoundBed

    def document(self) -> dict[str, Any]:
        """The suggestion as a JSON object, angles and emissivity left to the user."""
        kind = self.region.kind.name.lower()
        return {"name": self.region.name, "kind": kind, **asdict(self.area)}


def suggest_regions(
    campaign: Campaign | Config | str | Path = ".", session: str | Path | None = None
) -> list[SuggestedRegion]:
    """Regions found in the first frames of a session, of the running recording, or in the camera's next ones.

    Nothing is written. Raises `NoAnswerError` if there is none, and as `usable_frame`; `SessionError` if the
    session has no frame with temperatures.

    Examples
    --------
    >>> for suggestion in fieldkit.suggest_regions("dunes"):                               # doctest: +SKIP
    ...     region, kind = suggestion.region, suggestion.region.kind.name.lower()
    ...     dunes.add_region(region.name, points=region.points_px, kind=kind)
    """
    config = config_of(campaign)
    recorded = session or session_in_progress(config.recordings)
    frames = _next_frames_k(config) if recorded is None else first_frames_k(Path(recorded))
    return suggestions_in(frames.mean(axis=0), config.regions, view_of_frames(config, frames).noise_k)


def suggestions_in(
    frame: FloatArray, present: Sequence[Region], noise_k: float = math.nan
) -> list[SuggestedRegion]:
    """Regions found in a frame (rows, cols) of kelvin apart from those `present`; noise as in `CameraView`.

    The one that differs least from its surroundings is suggested as reference where there is none: level sand
    receives the light that level ground receives. Whether it is level must be measured. It comes first.
    Raises `NoAnswerError` if there is none.
    """
    shape = frame.shape[0], frame.shape[1]
    present_pixels = np.any([region.mask(shape) for region in present if not region.camera], axis=0)
    beds_in_frame = find_beds(frame, noise_k)
    beds = [bed for bed in beds_in_frame if not (_outline("", bed).mask(shape) & present_pixels).any()]
    if not beds:
        raise NoAnswerError(Words("error.all_drawn"), fix=FIX)
    wants_reference = all(region.kind is not RegionKind.REFERENCE for region in present)
    reference = min(beds, key=lambda bed: bed.contrast_k) if wants_reference else None
    names = {region.name for region in present}
    free = (name for number in count(1) if (name := f"bed-{number}") not in names)
    level = next(free) if wants_reference and "flat" in names else "flat"
    suggestions = [
        SuggestedRegion(_outline(level if bed is reference else next(free), bed, bed is reference), bed)
        for bed in beds
    ]
    # no configuration has targets alone
    return sorted(suggestions, key=lambda suggestion: suggestion.area is not reference)


def add_suggested(draft: Draft, suggestions: Iterable[SuggestedRegion]) -> None:
    """Add suggested regions to a ``fieldkit.toml``; raises as `add_region`."""
    for suggestion in suggestions:
        region = suggestion.region
        add_region(draft, region.name, points=region.points_px, kind=region.kind.name.lower())


def _outline(name: str, bed: FoundBed, is_reference: bool = False) -> Region:
    return Region(name, RegionKind.REFERENCE if is_reference else RegionKind.TARGET, bed.points_px)


def _next_frames_k(config: Config) -> FloatArray:
    """The camera's next usable frames (n, rows, cols)."""
    with open_instruments(config, allow_missing=True) as instruments:
        frames = [usable_frame(instruments) for _ in range(FRAMES)]
        info = next(info for info in instruments.streams if info.name == frames[0].stream)
    if not has_temperatures(info):
        raise NoAnswerError("the camera's temperatures are not known", fix=Action.DOCTOR() + " shows why")
    return np.array([frame_k(info, frame.counts, frame.metadata_rows) for frame in frames], np.float64)
