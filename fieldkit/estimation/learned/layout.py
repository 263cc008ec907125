"""Places of the state vector.

For each region the stores of its layer; then what is smooth (slow gusts, a common flux, changes of the air,
slow exchange of each bed's own), and what drives it in the same order; then what is shared and varies
(gusts, beam, board), what is constant: gain, diffuse light and its shape, longwave, air, wind, a further
session's exchange, the level of the first reference, the beds' normals times the gain, offsets, drifts; last
what each region does alone within minutes.

A target is any region but the first reference, to which all others are compared: a further reference is a
target whose slope is stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from fieldkit.estimation.bins import RegionColumns
from fieldkit.estimation.normal import tangent_pair
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.surface_kinds import Unlike
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.horizon import Horizon, sky_view_factor
from fieldkit.physics.layer_modes import MODES

GUSTS = ("gust", "longer_gust", "longest_gust")
"""Parts of the exchange's changes with the wind, from quick to slow."""
SMOOTH = ("slow_gust", "common_flux", "air_change")
STORES = 1 + MODES
"""Places of a layer: its level before the first minute, and what flowed in since."""
SHARED = (
    *GUSTS,
    *("beam", "moment", "edge", "board", "camera"),
    *("gain", "diffuse", "circumsolar", "brightening", "longwave", "air", "air_drift", "wind"),
    "session_exchange",
)


@dataclass(frozen=True)
class Layout:
    """Places in the state of regions: references first, the flattest of them leading, then the others.

    `columns` are their columns of the history, `known` (r, 3) normals of the references and `level_sds` (r,)
    the standard deviations of their directions in radians. `facing` has for each target (3, k), whose columns
    span its normal: three axes, or with a known azimuth two. `horizons` and `unlike` are of each region; the
    latter is its surface against that of the references.
    """

    columns: IntArray
    known: FloatArray
    level_sds: FloatArray
    facing: tuple[FloatArray, ...]
    horizons: tuple[Horizon, ...]
    unlike: tuple[Unlike, ...]

    @classmethod
    def of(cls, columns: RegionColumns, targets: IntArray, settings: EstimatorSettings) -> Layout:
        """References and some of the targets, given as columns."""
        flattest_first = np.argsort(-columns.reference_normals[:, 2], kind="stable")
        chosen = np.concatenate([columns.references[flattest_first], targets])
        is_known = settings.azimuth == "known"
        facing = tuple(_facing(columns.regions[column], is_known) for column in chosen[1:])
        names = [columns.regions[column].name for column in chosen]
        horizons = tuple(settings.horizon_of(name) for name in names)
        unlike = tuple(settings.unlike(name) for name in names)
        known = columns.reference_normals[flattest_first]
        level_sds = np.radians([settings.level_sd_deg(name) for name in names[: len(known)]])
        return cls(chosen, known, level_sds, facing, horizons, unlike)

    @cached_property
    def sky_views(self) -> FloatArray:
        """Share of the sky that each region's horizon leaves (regions,)."""
        return np.array([sky_view_factor(horizon) for horizon in self.horizons])

    @cached_property
    def exchanges(self) -> FloatArray:
        """Heat exchange of each region over that of the references (regions,)."""
        return np.array([surface.exchange for surface in self.unlike])

    @cached_property
    def absorbs(self) -> FloatArray:
        """Light that each region absorbs over that of the references (regions,)."""
        return np.array([surface.light for surface in self.unlike])

    def unlike_of(self, target: int) -> Unlike:
        """A target's surface against that of the references."""
        return self.unlike[self.region(target)]

    @property
    def stated(self) -> int:
        """Number of the targets whose slope is stated; they come first."""
        return len(self.known) - 1

    @cached_property
    def targets(self) -> int:
        """Number of targets."""
        return len(self.facing)

    def stated_normal(self, target: int) -> FloatArray:
        """Normal of a target whose slope is stated, in the axes of `facing` (k,)."""
        return np.asarray(self.known[self.region(target)] @ self.facing[target])

    @staticmethod
    def region(target: int) -> int:
        """Place of a target among the regions."""
        return 1 + target

    @cached_property
    def level_axes(self) -> FloatArray:
        """Directions (3, 2) in which the first reference may be off level."""
        return np.stack(tangent_pair(self.known[0]), axis=1)

    @cached_property
    def regions(self) -> int:
        """Number of regions."""
        return self.columns.size

    def stores(self, region: int) -> slice:
        """Level and stores of a region's layer."""
        return slice(region * STORES, (region + 1) * STORES)

    def place(self, name: str) -> int:
        """Place of something shared."""
        return self._shared_places[name]

    @cached_property
    def _shared_places(self) -> dict[str, int]:
        drives = [f"{name}_drive" for name in SMOOTH]
        blocks = ((self.smooth.start, SMOOTH), (self.drives.start, drives), (self.drives.stop, SHARED))
        return {name: place for first, names in blocks for place, name in enumerate(names, first)}

    @cached_property
    def smooth(self) -> slice:
        """Places of processes without jumps, shared ones first, which follow the stores."""
        first = self.regions * STORES
        return slice(first, first + len(SMOOTH) + self.targets)

    @cached_property
    def drives(self) -> slice:
        """Places of what drives each of `smooth`."""
        return slice(self.smooth.stop, 2 * self.smooth.stop - self.smooth.start)

    def slow_exchange(self, target: int) -> int:
        """Place of a target's own slow exchange."""
        return self.regions * STORES + len(SMOOTH) + target

    def slow_exchange_drive(self, target: int) -> int:
        """Place of what drives a target's own slow exchange."""
        return self.slow_exchange(self.targets) + len(SMOOTH) + target

    @cached_property
    def level(self) -> slice:
        """Places of how far the first reference is off level times the gain, along `level_axes`."""
        first = self.drives.stop + len(SHARED)
        return slice(first, first + 2)

    def normal(self, target: int) -> slice:
        """Places of a target's normal times the gain, in the axes of `facing`."""
        return self._normals[target]

    @cached_property
    def _normals(self) -> list[slice]:
        # asked for a thousand times a minute
        bounds = self.level.stop + np.cumsum([0, *(axes.shape[1] for axes in self.facing)])
        return [slice(*pair) for pair in pairwise(bounds.tolist())]

    def offset(self, region: int) -> int:
        """Place of the offset of any region but the first reference, to which offsets refer."""
        return int(self.normal(self.targets - 1).stop) + region - 1

    def drift(self, region: int) -> int:
        """Place of the drift of any region but the first reference."""
        return self.offset(region) + self.regions - 1

    def own(self, region: int) -> int:
        """Place of what a region's temperature does alone within minutes."""
        return self.drift(self.regions) + region

    def own_response(self, target: int) -> int:
        """Place of how much more a target warms by the same flux, as a share."""
        return self.own(self.regions) + target

    def own_exchange(self, target: int) -> int:
        """Place of a target's lasting exchange over that of the references."""
        return self.own_response(self.targets) + target

    def drying(self, target: int) -> int:
        """Place of a target's flux that only fades."""
        return self.own_exchange(self.targets) + target

    @cached_property
    def own_places(self) -> IntArray:
        """Places of what each region's temperature does alone (regions,)."""
        return self.own(0) + np.arange(self.regions)

    @cached_property
    def gain_and_normals(self) -> IntArray:
        """Places of the gain and of all normals times the gain."""
        normals = range(self.normal(0).start, self.normal(self.targets - 1).stop)
        return np.array([self.place("gain"), *normals], np.int64)

    @cached_property
    def lasting_places(self) -> IntArray:
        """Places of what one session leaves to the next: constants of the ground and of each bed.

        How much more one bed gives off than another depends on where the wind comes from.
        """
        own = range(self.own_response(0), self.own_response(self.targets))
        level = range(self.level.start, self.level.stop)
        return np.array([self.place("wind"), *self.gain_and_normals, *own, *level], np.int64)

    @cached_property
    def size(self) -> int:
        """Number of places."""
        return self.drying(self.targets)


def _facing(region: Region, is_azimuth_known: bool) -> FloatArray:
    # a level reference has no azimuth: it may be off to any side
    is_level = region.kind is RegionKind.REFERENCE and not region.tilt_deg > 0.0
    if is_level or not (is_azimuth_known and np.isfinite(region.azimuth_deg)):
        return np.eye(3)
    azimuth = np.radians(region.azimuth_deg)
    return np.array([[np.sin(azimuth), 0.0], [np.cos(azimuth), 0.0], [0.0, 1.0]])
