"""Regions suggested in drawn frames: how many lie inside a bed, and how many of the beds are found.

Beds are turned, shifted and scaled at a random time of day, on sand and in weather that a seed draws; people,
cables and boxes stand among them, and in some frames there is more noise. Or the ground around them is in
relief. The truth is the scene's outlines of the beds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.result import Result, Row
from fieldkit.model.arrays import BoolArray, ByteArray, FloatArray
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Region, RegionKind
from fieldkit.recording.suggesting import suggestions_in
from fieldkit.simulation import Facet, Scene, sand_slopes
from fieldkit.simulation.drawn_field import drawn_scene
from fieldkit.simulation.facets import FRAME_SHAPE
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.terrain import Terrain

SCENES = 150
MARGIN_PX = 2.0
HOUR_NS = 3_600_000_000_000
INCLUDED = "150 frames of the field, moved, turned, cluttered, noisy, 9 to 16 h; 50 with ground in relief"
INSIDE = Row("inside", "suggested regions that lie inside a bed", ">= 95", "%", INCLUDED)
SUGGESTED = Row("suggested", "regions suggested", "", "regions", INCLUDED)
FOUND = Row("found", "beds that are found", "", "%", INCLUDED)
LEVEL = Row("level", "references suggested that are the level bed, where it is found", "", "%", INCLUDED)


@dataclass(frozen=True, slots=True)
class Drawn:
    """A frame, shape (120, 160), in kelvin, and the beds in it."""

    frame: FloatArray
    beds: tuple[Facet, ...]


@dataclass(frozen=True, slots=True)
class Score:
    """Regions suggested, those inside a bed, and the beds found and drawn.

    `levels` is the number of frames in which the level bed is found, `references` of those in which it is
    suggested as reference.
    """

    suggested: int
    inside: int
    found: int
    beds: int
    levels: int
    references: int

    def __add__(self, other: Score) -> Score:
        return Score(*(getattr(self, key) + getattr(other, key) for key in self.__slots__))


def run() -> list[Result]:
    """All frames; takes about four minutes of processor time."""
    frames = [drawn_frame(seed) for seed in range(SCENES)] + [in_relief(seed) for seed in range(SCENES // 3)]
    total = sum(map(score, frames), start=Score(0, 0, 0, 0, 0, 0))
    return [
        INSIDE.result(100.0 * total.inside / total.suggested),
        SUGGESTED.result(total.suggested),
        FOUND.result(100.0 * total.found / total.beds, f"of {total.beds}"),
        LEVEL.result(100.0 * total.references / total.levels, f"of {total.levels}"),
    ]


def score(drawn: Drawn) -> Score:
    """Score of the regions suggested in a frame against its beds."""
    try:
        suggestions = [suggestion.region for suggestion in suggestions_in(drawn.frame, ())]
    except NoAnswerError:
        suggestions = []
    beds = [_mask(bed.points_px) for bed in drawn.beds]
    under = [_bed_under(_mask(suggestion.points_px), beds) for suggestion in suggestions]
    level = next((number for number, bed in enumerate(drawn.beds) if bed.is_reference), None)
    kinds = [suggestion.kind for suggestion in suggestions]
    references = [at for at, kind in zip(under, kinds, strict=True) if kind is RegionKind.REFERENCE]
    return Score(
        suggested=len(under),
        inside=sum(at is not None for at in under),
        found=len(set(under) - {None}),
        beds=len(beds),
        levels=int(level is not None and level in under),
        references=int(level is not None and level in references),
    )


def drawn_frame(seed: int) -> Drawn:
    """A frame of the field: as it stands for every fourth seed, else moved, cluttered, noisy too."""
    random, kind = np.random.default_rng([seed, 1]), seed % 4
    scene = _at_some_time(random, seed)
    scene = replace(scene, facets=moved_beds(random) if kind else BEDS)
    scene = drawn_scene(scene) if seed % 3 else scene
    frame = scene.frame(scene.start_ns, 1).astype(np.float64)
    if kind >= 2:
        frame = add_clutter(frame, random, int(random.integers(1, 5)))
    if kind == 3:
        frame += random.choice([0.05, 0.15, 0.3]) * random.standard_normal(FRAME_SHAPE)
    return Drawn(frame, scene.facets)


def in_relief(seed: int, *, with_beds: bool = True) -> Drawn:
    """A frame of ground in relief, hills for even seeds, ridges for odd ones, with beds on it or without."""
    random = np.random.default_rng([seed, 2])
    relief = gaussian_filter(random.standard_normal(FRAME_SHAPE), random.uniform(4.0, 15.0))
    relief *= random.uniform(1.0, 8.0) / relief.std()
    down, right = np.gradient(np.abs(relief) if seed % 2 else relief)
    normals = np.stack([-right, down, np.ones(FRAME_SHAPE)], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    scene = _at_some_time(random, seed)
    scene = replace(
        scene,
        terrain=Terrain(normals, np.zeros((len(normals), 36))),
        facets=moved_beds(random) if with_beds else (),
        ground=replace(scene.ground, depth_m=0.02 if seed % 3 else 0.3),
    )
    return Drawn(scene.frame(scene.start_ns, 1).astype(np.float64), scene.facets)


def _at_some_time(random: np.random.Generator, seed: int) -> Scene:
    """The field at a random time from a quarter past nine to four."""
    start_ns = ALAMOSA_NOON_NS + round(random.uniform(-2.75, 4.0) * HOUR_NS)
    return sand_slopes(start_ns=start_ns, duration_s=60.0, seed=seed)


def moved_beds(random: np.random.Generator) -> tuple[Facet, ...]:
    """At least two beds of the field, as a camera sees them that was turned, moved and raised."""
    while True:
        angle, scale = random.uniform(-np.pi, np.pi), random.uniform(0.7, 1.0)
        turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        middle, shift = np.array([79.5, 59.5]), random.uniform(-12.0, 12.0, 2)
        beds = [(bed, (np.array(bed.points_px) - middle) @ turn.T + middle + shift) for bed in BEDS]
        in_view = [
            replace(bed, points_px=tuple((float(x), float(y)) for x, y in corners))
            for bed, corners in beds
            if (corners >= MARGIN_PX).all() and (corners <= np.array(FRAME_SHAPE[::-1]) - 1 - MARGIN_PX).all()
        ]
        if len(in_view) >= 2:
            return tuple(in_view)


def add_clutter(frame: FloatArray, random: np.random.Generator, count: int) -> FloatArray:
    """A frame with people, cables, vessels and boxes before it, mostly warmer than the ground."""
    for _ in range(count):
        shape = (_person, _cable, _vessel, _box)[random.integers(4)](random)
        kelvin = np.median(frame) + random.uniform(2.0, 15.0) * random.choice([1.0, 1.0, -0.5])
        soft = gaussian_filter(shape.astype(np.float64), 0.7)
        frame = frame * (1.0 - soft) + kelvin * soft
    return frame


def _person(random: np.random.Generator) -> ByteArray:
    image, (x, y) = _place(random)
    angle, length, width = random.uniform(0.0, 180.0), random.integers(8, 25), random.integers(3, 8)
    cv2.ellipse(image, (x, y), (int(length), int(width)), angle, 0, 360, 1, cv2.FILLED)
    return image


def _cable(random: np.random.Generator) -> ByteArray:
    image, place = _place(random)
    points = np.cumsum(random.normal(0.0, 14.0, (8, 2)), axis=0) + place
    thickness = int(random.integers(1, 3))
    cv2.polylines(image, [points.astype(np.int32)], isClosed=False, color=1, thickness=thickness)
    return image


def _vessel(random: np.random.Generator) -> ByteArray:
    image, place = _place(random)
    cv2.circle(image, place, int(random.integers(2, 10)), 1, cv2.FILLED)
    return image


def _box(random: np.random.Generator) -> ByteArray:
    image, place = _place(random)
    width, height = random.uniform(4.0, 20.0, 2)
    corners = cv2.boxPoints((place, (width, height), random.uniform(0.0, 90.0)))
    cv2.fillPoly(image, [corners.astype(np.int32)], 1)
    return image


def _place(random: np.random.Generator) -> tuple[ByteArray, tuple[int, int]]:
    """An empty image and a pixel (x, y) of it."""
    rows, cols = FRAME_SHAPE
    return np.zeros(FRAME_SHAPE, np.uint8), (int(random.integers(cols)), int(random.integers(rows)))


def _mask(points_px: Sequence[tuple[float, float]]) -> BoolArray:
    return Region("outline", RegionKind.TARGET, tuple(points_px)).mask(FRAME_SHAPE)


def _bed_under(inside: BoolArray, beds: Sequence[BoolArray]) -> int | None:
    """Number of the bed that covers every pixel of a region; None where none does."""
    return next((number for number, bed in enumerate(beds) if bed[inside].all()), None)
