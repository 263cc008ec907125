"""The beds: plane surfaces of sand, where they lie in the frame, and the ground around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from fieldkit.model.arrays import SingleArray
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.horizon import Horizon
from fieldkit.physics.slab import Slab, Stack

FRAME_SHAPE = (120, 160)
"""Rows and columns of the frame in which facets are drawn."""

_INSET = 0.78  # of a bed's outline, so that regions avoid the blurred edges
_BLUR_PX = 0.7  # what a good lens does to an edge

Outline = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Facet:
    """One plane bed.

    `points_px` are (x, y) in pixels of a 160x120 frame. `tilt_deg` is from horizontal, `azimuth_deg` of the
    normal from north, clockwise: the truth. `emissivity` is that of the camera's band. `depth_m` of sand
    lies over an insulating sheet, or over the layers `below`; 0.2 m or more is practically bottomless for a
    day. `horizon` hides the sun and some of the sky. `is_reference` marks the bed whose slope is given to the
    estimator.
    """

    name: str
    points_px: Outline
    tilt_deg: float = 0.0
    azimuth_deg: float = 180.0
    albedo: float = 0.20
    emissivity: float = 0.90
    emissivity_broadband: float = 0.90
    depth_m: float = 0.02
    conductivity_w_m_k: float = 0.25
    heat_capacity_j_m3_k: float = 1.3e6
    is_reference: bool = False
    below: Stack = ()
    horizon: Horizon = ()

    @property
    def stack(self) -> Stack:
        """The layers that store the bed's heat, from the surface down."""
        return (Slab(self.depth_m, self.conductivity_w_m_k, self.heat_capacity_j_m3_k), *self.below)

    def region(self) -> Region:
        """Region as a careful operator would draw it: the outline, inset by a tenth on each side."""
        corners = np.asarray(self.points_px)
        inner = corners.mean(axis=0) + _INSET * (corners - corners.mean(axis=0))
        return Region(
            name=self.name,
            kind=RegionKind.REFERENCE if self.is_reference else RegionKind.TARGET,
            points_px=tuple((round(float(x), 1), round(float(y), 1)) for x, y in inner),
            tilt_deg=self.tilt_deg,
            azimuth_deg=self.azimuth_deg,
            emissivity=self.emissivity,
        )


GROUND = Facet("ground", (), albedo=0.19, depth_m=0.30)
"""The natural ground around the beds: flat, bottomless, and everywhere else in the frame."""


def pixel_shares(facets: Sequence[Facet]) -> SingleArray:
    """Share of each pixel that shows each of k facets, (k + 1, pixels), the ground last; columns add up to 1.

    Each facet covers those before it; edges are blurred as by a lens.
    """
    layers = np.zeros((len(facets) + 1, *FRAME_SHAPE))
    layers[-1] = 1.0
    for number, facet in enumerate(facets):
        mask = Region(facet.name, RegionKind.TARGET, facet.points_px).mask(FRAME_SHAPE)
        layers[:, mask] = 0.0
        layers[number, mask] = 1.0
    soft = np.stack([gaussian_filter(layer, _BLUR_PX, mode="nearest") for layer in layers])
    shares: SingleArray = (soft / soft.sum(axis=0)).reshape(len(layers), -1).astype(np.float32)
    return shares
