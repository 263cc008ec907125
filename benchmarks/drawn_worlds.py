"""Worlds drawn as a field is uncertain: truths on which an estimator is tested that does not know.

A seed draws depth, thermal inertia, exchange, sky, and the errors of meters and camera; beds and a flat
reference warm from 9 h local on, and the minutes from local noon are what an estimator gets. Quoted spreads
are standard deviations, ranges are uniform (those of ratios and of the exchange in the logarithm).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.arrays import FloatArray
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.slab import Slab
from fieldkit.recording.predict import field_history
from fieldkit.simulation import ClearSky, Exchange, Facet, MeasuredSky, Sky
from fieldkit.simulation.boards import Board
from fieldkit.simulation.drawn_field import DrawnField, Spread, drawn_field
from fieldkit.simulation.scene_series import SceneModel
from fieldkit.weather import packaged_day, read_station_file

BROKEN = Path(__file__).parents[1].parent / "shared" / "data" / "weather" / "slv15365.dat"
"""Broken cloud at Alamosa, 2015-12-31, in a `shared` folder beside the project where there is one."""
STILL = Exchange(18.15, 0.0)
"""The paper's exchange, whatever the wind."""
NOISE_K = 0.05
Bed = tuple[float, float]
BEDS_SOUTH: tuple[Bed, ...] = ((5.0, 180.0), (15.0, 180.0), (25.0, 180.0))
CONFIGURED_SLAB = Slab(depth_m=0.03)
GUESSED = Spread(
    sand=CONFIGURED_SLAB,
    inertia=(0.7, 1.4),
    damp_share=0.0,
    albedo_sd=0.0,
    own_albedo_sd=0.0,
    own_emissivity_sd=0.0,
    still_w_m2_k=(10.0, 30.0),
    per_wind=(1.5, 1.5),
    linke_turbidity=(3.0, 3.0),
)
"""As a careful experimenter would guess a field: dry even sand, parameters within a third or a half."""
DRIFT_SD_K_PER_H = 0.1
SOUTH, RANDOM = "south", "random"
CLEAR, BROKEN_CLOUD, AUGUST, JUNE = "clear", "broken", "august", "june"
DECEMBER, FEBRUARY = "december", "february"
NOON_H, LEAD_MIN, SESSION_MIN = 12.0, 180, 180
WITHIN_MIN = 0.5
"""Boards are held by hand: they come and go within a minute and not at its ends."""
BOARD_MIN, FIRST_BOARD_MIN, BETWEEN_BOARDS_MIN = 5, 10, 15

PAPER_SITE = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
SUMMER_DAYS = {AUGUST: "2017-08-30", JUNE: "2017-06-21"}
"""Days by formula at the paper's site; the first is the paper's."""
WINTER_DAYS = {DECEMBER: "2015-12-10", FEBRUARY: "2016-02-05"}
"""Days by formula at Alamosa."""
WINTER_AIR_K = 270.0
DAY_NS = 1440 * MINUTE_NS


@dataclass(frozen=True, slots=True)
class BedErrors:
    """Camera errors of the targets against the reference, (targets,): at the start, and their drifts."""

    offsets_k: FloatArray
    drifts_k_per_h: FloatArray


@dataclass(frozen=True, slots=True)
class World:
    """Minutes of a session, regions with their true slopes, what the estimator knows; the truth."""

    history: History
    regions: tuple[Region, ...]
    settings: EstimatorSettings
    field: DrawnField
    errors: BedErrors


def drawn_world(
    seed: int,
    day: str,
    beds: str = SOUTH,
    *,
    as_configured: bool = False,
    known_bed: bool = False,
    offset_sd_k: float = 0.25,
    shade_test: bool = False,
    measured_ground: bool = False,
    start_h: float = NOON_H,
    minutes: int = SESSION_MIN,
    visit: int = 0,
) -> World:
    """One world: a flat reference and three beds, which have been warming for three hours at the start.

    Parameters
    ----------
    seed
        Of everything drawn.
    day
        ``"clear"`` or ``"broken"`` at Alamosa, a key of `SUMMER_DAYS` or `WINTER_DAYS`, or the path of a
        station's file.
    beds
        ``"south"`` for 5, 15 and 25 degrees to the south, ``"random"`` for 3 to 30 degrees to any side.
    as_configured
        The world is as the settings say; only offsets and noise are drawn.
    known_bed
        The first bed is a reference too.
    offset_sd_k
        Standard deviation of the beds' offsets, which the settings state. [K]
    shade_test
        A board lies over each bed in turn for five minutes of the first hour.
    measured_ground
        A field with more physics than the estimator has: gusts, damp beds, own albedo and emissivity.
    start_h, minutes
        Start in mean solar time of the zone, from midnight; length of the session. [h], [min]
    visit
        Number of the session in that field: the camera's offsets and noise are others in each.
    """
    random = np.random.default_rng(seed)
    slopes = BEDS_SOUTH if beds == SOUTH else random_beds(random)
    field = _field(seed, as_configured=as_configured, measured_ground=measured_ground)
    drift_sd_k_per_h = 0.0 if as_configured else DRIFT_SD_K_PER_H
    random = np.random.default_rng((seed, visit)) if visit else random
    errors = BedErrors(offset_sd_k * random.standard_normal(3), drift_sd_k_per_h * random.standard_normal(3))
    outline = regions(slopes)
    model, noon_ns = _model(day, outline, field, shade_test)
    begin_ns = noon_ns + (round(60.0 * (start_h - NOON_H)) - LEAD_MIN) * MINUTE_NS
    history = field_history(model, begin_ns, LEAD_MIN + minutes).since(LEAD_MIN)
    readings = _readings(history, field, errors, random)
    settings = settings_of(beds, model.site, offset_sd_k)
    return World(readings, _with_known(outline) if known_bed else outline, settings, field, errors)


def settings_of(beds: str, site: Site, offset_sd_k: float = 0.25) -> EstimatorSettings:
    """Settings of an estimate of drawn beds; the azimuths of those to the south are known."""
    configured = EstimatorSettings(slab=CONFIGURED_SLAB, offset_sd_k=offset_sd_k, noise_k=NOISE_K, site=site)
    return replace(configured, azimuth="known") if beds == SOUTH else configured


def regions(beds: Sequence[Bed]) -> tuple[Region, ...]:
    """The flat reference and the beds."""
    none = ((0.0, 0.0),)
    targets = (
        Region(f"bed{i}", RegionKind.TARGET, none, tilt, azimuth) for i, (tilt, azimuth) in enumerate(beds)
    )
    return (Region("flat", RegionKind.REFERENCE, none, 0.0, 0.0), *targets)


def random_beds(random: np.random.Generator) -> tuple[Bed, ...]:
    return tuple((float(random.uniform(3.0, 30.0)), float(random.uniform(0.0, 360.0))) for _ in range(3))


def _field(seed: int, *, as_configured: bool, measured_ground: bool) -> DrawnField:
    """The field of a world; one as configured has the settings' sand, sky and exact meters."""
    if measured_ground:
        return drawn_field(seed)
    # the wind is that of the measured minutes
    field = replace(drawn_field(seed, GUESSED), gusts=None)
    if not as_configured:
        return field
    configured = replace(
        field, sand=(CONFIGURED_SLAB,), exchange=STILL, circumsolar_share=1.0, light_factor=1.0
    )
    return replace(configured, longwave_error_w_m2=0.0, air_error_k=0.0)


def _model(
    day: str, outline: tuple[Region, ...], field: DrawnField, shade_test: bool
) -> tuple[SceneModel, int]:
    """The beds on that day, and local noon."""
    site, sky, noon_ns = day_of(day)
    facets = tuple(
        field.bed(Facet(region.name, (), region.tilt_deg, region.azimuth_deg)) for region in outline
    )
    beds = [bed.name for bed in outline[1:]] if shade_test else []
    model = SceneModel(
        site=site,
        sky=field.sky(sky),
        beds=facets,
        ground=field.bed(Facet("ground", (), 0.0, 0.0)),
        exchange=field.exchange,
        transmissions=(),
        response_s=1.0,
        circumsolar_share=field.circumsolar_share,
        boards=tuple(_board(bed, number) for number, bed in enumerate(beds)),
    )
    return model, noon_ns


def _board(bed: str, number: int) -> Board:
    """The board over a bed, the beds one after the other."""
    begin_min = LEAD_MIN + FIRST_BOARD_MIN + WITHIN_MIN + BETWEEN_BOARDS_MIN * number
    return Board(bed, 60.0 * begin_min, 60.0 * (begin_min + BOARD_MIN))


def day_of(day: str) -> tuple[Site, Sky, int]:
    """Site, sky and local noon, to the hour of the mean sun, of a day."""
    if day in SUMMER_DAYS:
        return PAPER_SITE, ClearSky(), _noon_ns(PAPER_SITE, _date_ns(SUMMER_DAYS[day]))
    if day in WINTER_DAYS:
        site = packaged_day().site
        return site, ClearSky(air_temperature_k=WINTER_AIR_K), _noon_ns(site, _date_ns(WINTER_DAYS[day]))
    weather = (
        packaged_day() if day == CLEAR else read_station_file(BROKEN if day == BROKEN_CLOUD else Path(day))
    )
    middle_ns = int(weather.time_ns[len(weather.time_ns) // 2])
    return weather.site, MeasuredSky(weather), _noon_ns(weather.site, middle_ns // DAY_NS * DAY_NS)


def _date_ns(date: str) -> int:
    return int(np.datetime64(date, "ns").astype(np.int64))


def _noon_ns(site: Site, day_ns: int) -> int:
    return day_ns + round(12.0 - site.longitude_deg / 15.0) * 60 * MINUTE_NS


def _readings(history: History, field: DrawnField, errors: BedErrors, random: np.random.Generator) -> History:
    """The true minutes as the instruments read them."""
    hours = np.arange(len(history))[:, np.newaxis] / 60.0
    temperature = history.temperature_k + NOISE_K * random.standard_normal(history.temperature_k.shape)
    temperature[:, 1:] += errors.offsets_k + errors.drifts_k_per_h * hours
    return replace(weather_readings(history, field), temperature_k=temperature)


def weather_readings(history: History, field: DrawnField) -> History:
    """The true minutes with light and air as the instruments read them."""
    return replace(
        history,
        dni_w_m2=field.light_factor * history.dni_w_m2,
        dhi_w_m2=field.light_factor * history.dhi_w_m2,
        longwave_down_w_m2=history.longwave_down_w_m2 + field.longwave_error_w_m2,
        air_k=history.air_k + field.air_error_k,
    )


def _with_known(outline: tuple[Region, ...]) -> tuple[Region, ...]:
    flat, first, *others = outline
    return (flat, replace(first, kind=RegionKind.REFERENCE), *others)
