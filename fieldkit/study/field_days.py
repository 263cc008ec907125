"""The paper's field experiment (its section 5): its beds under a simulated clear sky, or recorded sessions.

The paper's recordings are not public. Here its sand beds of 30 August and 11 December 2017
stand under the scene's sky, which includes diffuse irradiance, longwave and stored heat, so the
paper's model meets the errors it met outdoors. Recorded sessions are treated alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from fieldkit.estimation.bins import History
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.estimator import Minute
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.statistics import ErrorSpan, errors_over_time
from fieldkit.model.arrays import FloatArray
from fieldkit.model.clock import utc_ns
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, Site
from fieldkit.model.units import MINUTE_NS
from fieldkit.physics.energy_balance import SurfaceParameters, surface_temperature
from fieldkit.physics.facet import tilt_azimuth
from fieldkit.physics.irradiance import direct_normal
from fieldkit.physics.radiance import surface_temperature_k
from fieldkit.physics.sun import sun_vectors
from fieldkit.results.report import report_part
from fieldkit.simulation import ClearSky, Facet, Scene
from fieldkit.study.runs import PAPER_SITE
from fieldkit.views.formatting import zone_name
from fieldkit.views.report.series import Series, modelled_temperature, series, temperature_rmse_k

NOISE_K = 0.05
SAND_DEPTH_M = 0.03
_OUTLINE = ((20, 20), (60, 20), (60, 60), (20, 60))


@dataclass(frozen=True, slots=True)
class PaperDay:
    """One day of the paper's experiment: its date, its beds facing south, and its air, roughly."""

    date: str
    tilts_deg: tuple[float, ...]
    air_k: float
    turbidity: float

    @property
    def month(self) -> str:
        """Three letters."""
        return f"{datetime.fromisoformat(self.date):%b}"


PAPER_DAYS = (
    PaperDay("2017-08-30", (10.0, 20.0), 303.0, 4.16),
    PaperDay("2017-12-11", (5.0, 15.0, 25.0), 283.0, 2.27),
)


@dataclass(frozen=True)
class FieldDay:
    """Data of one day for figures 12 and 13: measured and modelled temperatures, errors over time."""

    name: str
    measured_k: dict[str, FloatArray]
    modelled_k: dict[str, FloatArray]
    errors: dict[str, list[ErrorSpan]]
    zone: str

    @property
    def rmse_k(self) -> float:
        """RMSE of the modelled against the measured surface temperature of all beds, kelvin."""
        return temperature_rmse_k(self.measured_k, self.modelled_k)

    @property
    def mean_error_deg(self) -> float:
        """Mean absolute tilt error over beds and intervals."""
        spans = [span for bed in self.errors.values() for span in bed]
        return float(np.mean([span.mean for span in spans])) if spans else float("nan")


def field_days(sessions: Sequence[Path]) -> list[FieldDay]:
    """Sessions, or the paper's two days under a simulated sky."""
    if sessions:
        return [recorded_day(path, f"#{number}") for number, path in enumerate(sessions, 1)]
    # the paper's table ends at 30 degrees; its beds' direction was known
    settings = EstimatorSettings(model="paper", window_s=1200.0, azimuth="known", tilt_limit_deg=30.0)
    return [simulated_day(day, PAPER_SITE, settings) for day in PAPER_DAYS]


def simulated_day(day: PaperDay, site: Site, settings: EstimatorSettings) -> FieldDay:
    """The paper's beds from 12 to 15 h under a clear sky, estimated minute by minute."""
    scene = _scene(day, site)
    times = scene.start_ns + np.arange(181, dtype=np.int64) * MINUTE_NS
    minutes = _minutes(scene, times, settings)
    columns = series(minutes, scene.regions)
    weather = np.array([(m.longwave_down_w_m2, m.air_temperature_k) for m in map(scene.at, times.tolist())])
    modelled, measured = {}, {}
    for index, region in enumerate(scene.regions):
        dni_w_m2 = columns.direct_on(region.tilt_deg, region.azimuth_deg)
        name = _bed_name(day.month, region)
        modelled[name] = surface_temperature(dni_w_m2, weather[:, 0], weather[:, 1], SurfaceParameters())
        measured[name] = columns.contact_k[:, index]
    return FieldDay(
        day.date, measured, modelled, _errors(columns, day.month, site), zone_name(int(times[0]), site)
    )


def recorded_day(path: Path, label: str) -> FieldDay:
    """A session, estimated with its own configuration; the reference stands in for the weather.

    `label` distinguishes its beds from those of other sessions.
    """
    part = report_part(path)
    columns, surface = part.columns, part.settings.surface
    known_beds = [bed for bed in columns.targets if np.isfinite(bed.region.tilt_deg)]
    names = {bed.region.name: _bed_name(label, bed.region) for bed in known_beds}
    modelled = {names[bed.region.name]: modelled_temperature(columns, bed, surface) for bed in known_beds}
    measured = {names[bed.region.name]: columns.temperature_k[bed.region.name] for bed in known_beds}
    return FieldDay(
        path.stem,
        measured,
        modelled,
        _errors(columns, label, part.site),
        zone_name(int(columns.time_ns[0]), part.site),
    )


def _scene(day: PaperDay, site: Site) -> Scene:
    start = utc_ns(datetime.fromisoformat(f"{day.date}T12:00+09:00"))
    flat = Facet("flat", _OUTLINE, 0.0, 180.0, depth_m=SAND_DEPTH_M, is_reference=True)
    beds = [Facet(f"b{tilt:02.0f}", _OUTLINE, tilt, 180.0, depth_m=SAND_DEPTH_M) for tilt in day.tilts_deg]
    sky = ClearSky(day.turbidity, day.air_k)
    return Scene(site, sky, (flat, *beds), start, 3 * 3600.0)


def _minutes(scene: Scene, times: np.ndarray, settings: EstimatorSettings) -> list[Minute]:
    """The estimates of each minute, from the readings of the scene's instruments."""
    regions, surface = scene.regions, settings.surface
    sun = sun_vectors(times, scene.site, refraction=settings.refraction)
    noise = NOISE_K * np.random.default_rng(scene.seed).standard_normal((times.size, len(regions)))
    seen = np.array([scene.at(time).brightness_k[:-1] for time in times.tolist()]) + noise
    surface_k = surface_temperature_k(seen, surface.emissivity, settings.reflected_temperature_k)
    lux = np.array([scene.lux_reading(time) for time in times.tolist()])
    dni_w_m2 = direct_normal(settings.irradiance, lux, sun, times)
    history = History(times // MINUTE_NS, times, sun, surface_k, dni_w_m2)
    zenith, azimuth = tilt_azimuth(sun)
    chain = SlopeChain(regions, settings)
    return [
        Minute(
            time_ns=int(time),
            estimates=chain.at(history.until(row + 1)).slopes,
            temperature_k={region.name: float(surface_k[row, i]) for i, region in enumerate(regions)},
            spread_k={},
            pixels={},
            illuminance_lx=float(lux[row]),
            dni_w_m2=float(dni_w_m2[row]),
            irradiance_model=settings.irradiance.label,
            sun_zenith_deg=float(zenith[row]),
            sun_azimuth_deg=float(azimuth[row]),
            contact_k=tuple(scene.probe_readings(int(time)).tolist()),
            flags=Quality.GOOD,
            events=(),
        )
        for row, time in enumerate(times)
    ]


def _errors(columns: Series, label: str, site: Site) -> dict[str, list[ErrorSpan]]:
    """Errors of each bed of known slope, by nanoseconds since local midnight."""
    return {
        _bed_name(label, bed.region): errors_over_time(
            columns.of_day_ns(site), bed.estimated_tilt_deg, bed.region.tilt_deg
        )
        for bed in columns.targets
        if np.isfinite(bed.region.tilt_deg)
    }


def _bed_name(label: str, region: Region) -> str:
    """Short, so that five of them fit over a figure: ``10° Aug``."""
    return f"{region.tilt_deg:g}° {label}"
