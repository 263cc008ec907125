"""Products of a slope map as a rover's planner takes them; all but the risks with their standard uncertainty.

Definitions: `physics.terrain`; risk and uncertainty: `estimation.pixel_posterior`.

>>> from fieldkit.results.slope_map import slope_map
>>> slope_map("a.h5").products(Products(("slope", "ptilt"), limit_deg=20))            # doctest: +SKIP
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from fieldkit.estimation.instant import AlongSun
from fieldkit.estimation.pixel_posterior import TAIL, Measure, PixelPosterior
from fieldkit.estimation.pixel_slopes import SlopeMap
from fieldkit.model.arrays import FloatArray, SingleArray
from fieldkit.model.confidence import interval_sds
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.learnt import LearntParameter
from fieldkit.model.next_step import Argument
from fieldkit.model.site import Region, Site
from fieldkit.model.units import SECOND_NS
from fieldkit.physics.bodies import body_of
from fieldkit.physics.facet import normal, tilt_azimuth
from fieldkit.physics.sun import sun_vectors
from fieldkit.physics.terrain import climb_deg, northerly_tilt_deg, sunlit_cosine

NAMES = ("slope", "heading", "rdir", "ntilt", "solar", "uvw", "ptilt", "inertia")
LAYERS = (*NAMES[:5], "u", "v", "w", "ptilt", "cvar", "inertia")
"""Names of the layers that products have."""
SUNS = 144
TABLE_SIZE = 201


@dataclass(frozen=True, slots=True)
class Products:
    """Products to make of a map, by `names` of `NAMES`.

    `limit_deg`, in (0, 90), is the tilt whose exceedance `ptilt` is the probability of; `drive_deg` the
    direction of a drive, which `rdir` is the slope along, from north, clockwise. Raises `ConfigError` if a
    name is unknown, or an angle that a product needs is missing or out of range.
    """

    names: Sequence[str]
    limit_deg: float = math.nan
    drive_deg: float = math.nan

    def __post_init__(self) -> None:
        if unknown := [name for name in self.names if name not in NAMES]:
            raise ConfigError("not a product", place=repr(unknown[0]), fix=f"choose from {', '.join(NAMES)}")
        if "ptilt" in self.names and not 0.0 < self.limit_deg < 90.0:
            problem = "needs a tilt of 0 to 90 degrees that it is the risk of"
            raise ConfigError(problem, place="ptilt", fix=Argument("limit_deg", 20))
        if "rdir" in self.names and not math.isfinite(self.drive_deg):
            problem = "needs the direction of the drive, from north, clockwise"
            raise ConfigError(problem, place="rdir", fix=Argument("drive_deg", 90))


@dataclass(frozen=True, slots=True)
class Layer:
    """A number of every pixel, (rows, cols), NaN without a slope, and its standard uncertainty if any.

    `is_cyclic` are angles that begin anew after a turn.
    """

    name: str
    long_name: str
    units: str
    values: SingleArray
    sd: SingleArray | None = None
    standard_name: str = ""
    is_cyclic: bool = False


@dataclass(frozen=True, slots=True)
class _Kind:
    """Name of a layer that follows from the normal, and its function."""

    name: str
    long_name: str
    units: str
    measure: Measure
    standard_name: str = ""
    is_cyclic: bool = False
    quick: Measure | None = None
    """A faster form for uncertainties, where a hundred normals stand for each pixel."""


def layers(
    wanted: Products,
    slopes: SlopeMap,
    likelihood: PixelPosterior,
    *,
    site: Site,
    time_ns: int,
    regions: Sequence[Region],
    inertia: LearntParameter | None,
) -> list[Layer]:
    """The layers of products, in the order of `NAMES`, of a slope map and what its data say of each pixel.

    The sun shines at the site on the day of `time_ns`, UTC nanoseconds since 1970; `regions` are of one
    material with this thermal `inertia`, None where no model found it. Raises `NoAnswerError` for one that
    cannot be made.
    """
    layers = _of_normals(slopes, likelihood, list(_kinds(wanted, suns_of_day(site, time_ns))))
    if "ptilt" in wanted.names:
        # they have no uncertainty, for they state one
        steeper, worst = likelihood.risk(wanted.limit_deg)
        name = f"probability of a tilt of more than {wanted.limit_deg:g} degrees"
        layers.append(Layer("ptilt", name, "1", steeper))
        layers.append(
            Layer("cvar", f"mean of the steepest {TAIL:.0%} of the tilts that fit", "degree", worst)
        )
    if "inertia" in wanted.names:
        layers.append(_inertia(slopes, regions, inertia))
    return layers


def layer_along_sun(found: AlongSun, confidence: float) -> Layer:
    """The `rdir` of one frame, away from the sun; NaN where a second slope beyond the sun fits as well."""
    sd_deg = (found.high_deg - found.low_deg) / (2.0 * interval_sds(confidence))
    values, sd = (
        np.where(found.resolved, values, np.nan).astype(np.float32) for values in (found.tilt_deg, sd_deg)
    )
    away_deg = (found.azimuth_deg + 180.0) % 360.0
    name = f"slope along {away_deg:.0f} degrees, away from the sun, positive uphill"
    return Layer("rdir", name, "degree", values, sd)


def _kinds(wanted: Products, suns: FloatArray) -> Iterator[_Kind]:
    drive_deg = wanted.drive_deg
    kinds = (
        _Kind(
            "slope", "tilt from horizontal", "degree",
            lambda normals: tilt_azimuth(normals)[0], "ground_slope_angle",
            quick=lambda n: np.degrees(np.arctan2(np.hypot(n[..., 0], n[..., 1]), n[..., 2])),
        ),
        _Kind(
            "heading", "direction of the surface normal from true north, clockwise", "degree",
            lambda normals: tilt_azimuth(normals)[1], "ground_slope_direction", is_cyclic=True,
            quick=lambda n: np.degrees(np.arctan2(n[..., 0], n[..., 1])),
        ),
        _Kind(
            "rdir", f"slope along a drive towards {drive_deg:g} degrees, positive uphill", "degree",
            lambda normals: climb_deg(normals, drive_deg),
        ),
        _Kind("ntilt", "tilt towards north, negative towards south", "degree", northerly_tilt_deg),
        _Kind(
            "solar", "mean cosine of the sun's incidence over the body's day, zero while it is dark", "1",
            lambda normals: sunlit_cosine(normals, suns), quick=_tabulate(suns),
        ),
    )  # fmt: skip
    yield from (kind for kind in kinds if kind.name in wanted.names)
    if "uvw" in wanted.names:
        for axis, (name, direction) in enumerate((("u", "east"), ("v", "north"), ("w", "up"))):
            yield _Kind(name, f"component of the unit normal, {direction}", "1", itemgetter((..., axis)))


def suns_of_day(site: Site, time_ns: int) -> FloatArray:
    """Unit vectors to the sun at even steps of the body's day around a time."""
    day_ns = round(body_of(site).day_s * SECOND_NS)
    shares = (np.arange(SUNS) + 0.5) / SUNS - 0.5
    return sun_vectors(time_ns + np.rint(shares * day_ns).astype(np.int64), site)


def _tabulate(suns: FloatArray) -> Measure:
    """`sunlit_cosine` of normals that face up, looked up by their east and north components."""
    east, north = np.meshgrid(*[np.linspace(-1.0, 1.0, TABLE_SIZE)] * 2)
    up = np.sqrt(np.maximum(1.0 - east**2 - north**2, 0.0))
    table = sunlit_cosine(np.stack([east, north, up], axis=-1), suns).astype(np.float32)

    def look_up(normals: SingleArray) -> SingleArray:
        import cv2

        at = np.float32(TABLE_SIZE // 2) * (normals[..., :2] + np.float32(1.0))
        at = at.reshape(-1, at.shape[-2], 2)
        looked_up = cv2.remap(table, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
        return np.asarray(looked_up, np.float32).reshape(normals.shape[:-1])

    return look_up


def _of_normals(slopes: SlopeMap, likelihood: PixelPosterior, kinds: Sequence[_Kind]) -> list[Layer]:
    if not kinds:
        return []
    normals = normal(slopes.tilt_deg, slopes.azimuth_deg)
    measures: dict[str, Measure] = {kind.name: kind.quick or kind.measure for kind in kinds}
    cyclic = frozenset(kind.name for kind in kinds if kind.is_cyclic)
    deviations = likelihood.deviations(measures, cyclic=cyclic)
    return [
        Layer(
            kind.name, kind.long_name, kind.units, np.asarray(kind.measure(normals), np.float32),
            deviations[kind.name], kind.standard_name, kind.is_cyclic,
        )
        for kind in kinds
    ]  # fmt: skip


def _inertia(slopes: SlopeMap, regions: Sequence[Region], inertia: LearntParameter | None) -> Layer:
    """Thermal inertia of the regions, which share their material."""
    if inertia is None:
        problem = "only the learned model finds a thermal inertia, and the map is of another"
        raise NoAnswerError(problem, place="inertia", fix='set estimator.model = "learned", or omit inertia')
    rows, cols = slopes.state.shape
    inside = np.any([region.mask((rows, cols)) for region in regions], axis=0)
    inside &= np.isfinite(slopes.tilt_deg)
    values, sd = (
        np.where(inside, number, np.nan).astype(np.float32) for number in (inertia.value, inertia.sd)
    )
    return Layer("inertia", "thermal inertia of the regions' material", "J m-2 K-1 s-0.5", values, sd)
