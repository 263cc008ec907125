"""Worlds drawn as a field is uncertain: truths on which an estimator is tested that is not told them.

A seed draws depth, thermal inertia, exchange, sky, and the errors of meters and camera; beds and a flat
reference warm from 9 h local on, and the minutes from local noon are what an estimator gets. Quoted spreads
are standard deviations, ranges are uniform (that of the inertia in its logarithm).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.estimation_outdoors import BROKEN, NOISE_K, STILL, Bed, minute_means, regions
from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.facet import FloatArray
from fieldkit.physics.slab import Slab, Stack
from fieldkit.simulation import ClearSky, Exchange, Facet, MeasuredSky, Sky
from fieldkit.simulation.boards import Board
from fieldkit.simulation.scene_series import SceneModel
from fieldkit.weather import packaged, read_station_file

BEDS_SOUTH: tuple[Bed, ...] = ((5.0, 180.0), (15.0, 180.0), (25.0, 180.0))
TOLD_SLAB = Slab(depth_m=0.03)
BOTTOMLESS: Mapping[str, Any] = {"depth_m": 0.35, "layers": 8, "growth": 1.5}
"""More of the same sand below, which heat does not cross within a session."""
SOUTH, RANDOM = "south", "random"
CLEAR, BROKEN_CLOUD, AUGUST = "clear", "broken", "august"
LEAD_MIN, SESSION_MIN = 180, 180
BOARD_MIN, FIRST_BOARD_MIN, BETWEEN_BOARDS_MIN = 5, 10, 15

PAPER_SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
PAPER_DAY_NS = int(np.datetime64("2017-08-30", "ns").astype(np.int64))
DAY_NS = 1440 * MINUTE_NS


@dataclass(frozen=True, slots=True)
class Drawn:
    """What is true and not told: the layer, exchange, sky, and errors of the instruments.

    `meter` is measured over true irradiance; offsets (K), drifts (K/h) and noise are of the targets, those of
    the logged air temperature and longwave (W/m²) of the whole session.
    """

    sand: Stack
    exchange: Exchange
    circumsolar_share: float
    meter: float
    longwave_error_w_m2: float
    air_error_k: float
    offsets_k: FloatArray
    drifts_k_per_h: FloatArray


@dataclass(frozen=True, slots=True)
class World:
    """Minutes from local noon on, regions with their true slopes, what the estimator is told; the truth."""

    history: History
    regions: tuple[Region, ...]
    settings: EstimatorSettings
    drawn: Drawn


def drawn_world(
    seed: int,
    day: str,
    beds: str = SOUTH,
    *,
    told: bool = False,
    known_bed: bool = False,
    offset_sd_k: float = 0.25,
    shade_test: bool = False,
) -> World:
    """One world: a flat reference and three beds, three hours from local noon.

    Parameters
    ----------
    seed
        Of everything drawn.
    day
        ``"clear"`` or ``"broken"`` at Alamosa, ``"august"`` by formula at the paper's site, or the path of a
        station's file.
    beds
        ``"south"`` for 5, 15 and 25 degrees to the south, ``"random"`` for 3 to 30 degrees to any side.
    told
        The world is as the settings say; only offsets and noise are drawn.
    known_bed
        The first bed is a reference too.
    offset_sd_k
        Standard deviation of the beds' offsets, which the settings state. [K]
    shade_test
        A board lies over each bed in turn for five minutes of the first hour.
    """
    random = np.random.default_rng(seed)
    slopes = BEDS_SOUTH if beds == SOUTH else _random_beds(random)
    drawn = _as_told(_draw(random, offset_sd_k)) if told else _draw(random, offset_sd_k)
    outline = regions(slopes)
    model, noon_ns = _field(day, outline, drawn, shade_test)
    history = minute_means(model, noon_ns - LEAD_MIN * MINUTE_NS, LEAD_MIN + SESSION_MIN).since(LEAD_MIN)
    measured = _measured(history, drawn, random)
    if shade_test:
        measured = replace(measured, region_flags=_flags_of(model.boards, outline))
    settings = EstimatorSettings(
        azimuth="known" if beds == SOUTH else "free", slab=TOLD_SLAB, offset_sd_k=offset_sd_k, noise_k=NOISE_K
    )
    return World(measured, _with_known(outline) if known_bed else outline, settings, drawn)


def _random_beds(random: np.random.Generator) -> tuple[Bed, ...]:
    return tuple((float(random.uniform(3.0, 30.0)), float(random.uniform(0.0, 360.0))) for _ in range(3))


def _draw(random: np.random.Generator, offset_sd_k: float) -> Drawn:
    is_deep, depth_m = random.random() < 0.2, float(random.uniform(0.02, 0.06))
    inertia = float(np.exp(random.uniform(np.log(0.7), np.log(1.4))))
    # dry sand differs far more in conductivity than in heat capacity
    slab = replace(TOLD_SLAB, depth_m=depth_m, conductivity_w_m_k=TOLD_SLAB.conductivity_w_m_k * inertia**2)
    return Drawn(
        sand=(slab, replace(slab, **BOTTOMLESS)) if is_deep else (slab,),
        exchange=Exchange(float(random.uniform(10.0, 30.0))),
        circumsolar_share=float(random.uniform()),
        meter=1.0 + 0.08 * random.standard_normal(),
        longwave_error_w_m2=30.0 * random.standard_normal(),
        air_error_k=0.5 * random.standard_normal(),
        offsets_k=offset_sd_k * random.standard_normal(3),
        drifts_k_per_h=0.1 * random.standard_normal(3),
    )


def _as_told(drawn: Drawn) -> Drawn:
    """The same offsets in a world that is as the settings say."""
    return Drawn((TOLD_SLAB,), STILL, 1.0, 1.0, 0.0, 0.0, drawn.offsets_k, np.zeros(3))


def _field(day: str, outline: tuple[Region, ...], drawn: Drawn, shade_test: bool) -> tuple[SceneModel, int]:
    """The beds on that day, and local noon."""
    site, sky, noon_ns = _day(day)
    top, *below = drawn.sand
    sand = Facet(
        "ground",
        (),
        depth_m=top.depth_m,
        conductivity_w_m_k=top.conductivity_w_m_k,
        heat_capacity_j_m3_k=top.heat_capacity_j_m3_k,
        below=tuple(below),
    )
    facets = tuple(
        replace(sand, name=one.name, tilt_deg=one.tilt_deg, azimuth_deg=one.azimuth_deg) for one in outline
    )
    boards = _boards(outline) if shade_test else ()
    model = SceneModel(site, sky, facets, sand, drawn.exchange, (), 1.0, drawn.circumsolar_share, boards)
    return model, noon_ns


def _day(day: str) -> tuple[Site, Sky, int]:
    """Site, sky and local noon, to the hour of the mean sun, of a day."""
    if day == AUGUST:
        return PAPER_SITE, ClearSky(), _noon_ns(PAPER_SITE, PAPER_DAY_NS)
    weather = packaged() if day == CLEAR else read_station_file(BROKEN if day == BROKEN_CLOUD else Path(day))
    middle_ns = int(weather.time_ns[len(weather.time_ns) // 2])
    return weather.site, MeasuredSky(weather), _noon_ns(weather.site, middle_ns // DAY_NS * DAY_NS)


def _noon_ns(site: Site, day_ns: int) -> int:
    return day_ns + round(12.0 - site.longitude_deg / 15.0) * 60 * MINUTE_NS


def _boards(outline: tuple[Region, ...]) -> tuple[Board, ...]:
    starts = (LEAD_MIN + FIRST_BOARD_MIN + BETWEEN_BOARDS_MIN * number for number in range(len(outline) - 1))
    return tuple(
        Board(bed.name, 60.0 * start, 60.0 * (start + BOARD_MIN))
        for bed, start in zip(outline[1:], starts, strict=True)
    )


def _flags_of(boards: tuple[Board, ...], outline: tuple[Region, ...]) -> NDArray[np.int64]:
    """Flags of minutes and regions: shaded under the boards."""
    flags = np.zeros((SESSION_MIN, len(outline)), np.int64)
    names = [region.name for region in outline]
    for board in boards:
        first, last = (round(time_s / 60.0) - LEAD_MIN for time_s in (board.begin_s, board.end_s))
        flags[first:last, names.index(board.bed)] = int(Quality.SHADED)
    return flags


def _measured(history: History, drawn: Drawn, random: np.random.Generator) -> History:
    """What the instruments read of the true minutes."""
    hours = np.arange(len(history))[:, np.newaxis] / 60.0
    temperature = history.temperature_k + NOISE_K * random.standard_normal(history.temperature_k.shape)
    temperature[:, 1:] += drawn.offsets_k + drawn.drifts_k_per_h * hours
    return replace(
        history,
        temperature_k=temperature,
        dni_w_m2=drawn.meter * history.dni_w_m2,
        dhi_w_m2=drawn.meter * history.dhi_w_m2,
        longwave_down_w_m2=history.longwave_down_w_m2 + drawn.longwave_error_w_m2,
        air_k=history.air_k + drawn.air_error_k,
    )


def _with_known(outline: tuple[Region, ...]) -> tuple[Region, ...]:
    flat, first, *others = outline
    return (flat, replace(first, kind=RegionKind.REFERENCE), *others)
