"""Slopes from kept minutes are those of the estimator fed by samples, whatever the parameters."""

from dataclasses import fields, replace

import numpy as np
import pytest

from fieldkit.estimation.estimator import Estimator
from fieldkit.estimation.prior import Prior
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import SessionError
from fieldkit.model.site import Site
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.slab import Slab
from fieldkit.physics.trajectory import CameraPath, Trajectory
from fieldkit.results.minutes import bin_settings, measure, solve
from fieldkit.results.sources import config_for
from fieldkit.sessions.reader import open_session

OTHER = {
    "surface": SurfaceParameters(0.25, 0.85, 0.93, 900.0, 1.1, 0.012),
    "site": Site(-33.9, 151.2, 40.0),
    "light_stream": "lux",
    "measures": {"sun": "ghi"},
    "probes": {"b15": ("thermometer:T2", "thermometer:3")},
    "horizon": ((0.0, 40.0),),
    "horizons": {"b15": ((0.0, 30.0), (240.0, 40.0))},
    "irradiance": IrradianceModel(par_fraction=0.5, diffuse="none"),
    "method": "contours",
    "model": "full",
    "reference": "weather",
    "kinds": {"b15": "rock"},
    "window_s": 480.0,
    "azimuth": "known",
    "tilt_limit_deg": 12.0,
    "refraction": True,
    "reflected_temperature_k": 260.0,
    "noise_k": 0.2,
    "low_sun_deg": 29.0,
    "settle_s": 0.0,
    "min_minutes": 8,
    "contour_tolerance_w_m2": 3.0,
    "contour_threshold": 0.9,
    "scale": 1.1,
    "scale_sd": 0.3,
    "exchange_sd": 0.5,
    "offsets_k": {"b15": 0.4},
    "offset_sd_k": 0.7,
    "emissivity_sd": 0.1,
    "own_emissivity_sd": {"b15": 0.1},
    "factor_sd": 0.4,
    "drift_sd_k_per_h": 0.9,
    "slab": Slab(depth_m=0.1),
    "conductivity_sd": 0.6,
    "capacity_sd": 0.6,
    "sky": "isotropic",
    "ground_albedo": 0.5,
    "longwave_down_w_m2": 200.0,
    "diffuse_fraction": 0.4,
    "prior": Prior(gain_sd=0.2),
    "body": "mars",
    "air": "model",
    "kind": "wall",
    "same": True,
    "level_sds_deg": {"flat": 1.0},
    "limits": {"surface_temperature": (175.0, 285.0)},
    "confidence": 0.8,
    "target_half_width_deg": 1.0,
    "camera_path": CameraPath(Trajectory((0,), ((0.0, 0.0, 2.0),), ((0.0, 0.0, 0.0, 1.0),)), 50.0, (), 0.0),
}
"""For every setting another value; those of contours and of the full model bring these along."""
OF_CONTOURS = ("contour_tolerance_w_m2", "contour_threshold")
OF_FULL = (
    "slab", "conductivity_sd", "capacity_sd", "sky", "ground_albedo", "longwave_down_w_m2",
    "diffuse_fraction",
)  # fmt: skip
OF_LEARNED = ("prior", "kinds", "same", "level_sds_deg")
OF_ANY = (
    "surface", "probes", "irradiance", "window_s", "azimuth", "refraction", "reflected_temperature_k",
    "noise_k", "settle_s", "min_minutes", "scale", "scale_sd", "exchange_sd", "offsets_k", "offset_sd_k",
    "emissivity_sd", "own_emissivity_sd", "factor_sd", "drift_sd_k_per_h", "confidence",
    "target_half_width_deg",
)  # fmt: skip
TOGETHER = (OF_ANY, OF_CONTOURS, OF_FULL, OF_LEARNED)
"""What leaves slopes where all of it is another value; each alone takes a minute."""


@pytest.fixture(scope="module")
def recording(folder):
    path = sorted((folder / "recordings").glob("*.h5"))[0]
    with open_session(path) as session:
        config = config_for(session)
        return path, config.site, session.regions, tuple(session.streams.values()), list(session.samples())


def test_every_setting_is_tried():
    assert set(OTHER) == {field.name for field in fields(EstimatorSettings)}


def alone(name):
    is_together = any(name in names for names in TOGETHER)
    return pytest.param((name,), id=name, marks=[pytest.mark.slow] * is_together)


@pytest.mark.parametrize(
    "names", [*(pytest.param(names, id=f"{names[0]} and others") for names in TOGETHER), *map(alone, OTHER)]
)
def test_slopes_from_kept_minutes_are_the_estimators(recording, names):
    path, site, regions, streams, samples = recording
    settings = replace(EstimatorSettings(model="paper"), **{name: OTHER[name] for name in names})
    if names[0] in OF_CONTOURS:
        settings = replace(settings, method="contours")
    if names[0] in (*OF_FULL, "reference"):
        settings = replace(settings, model="full")
    if names[0] in OF_LEARNED:
        settings = replace(settings, model="learned")
    estimator = Estimator(site, regions, streams, settings)
    minutes = [minute for sample in samples for minute in estimator.add(sample)] + estimator.finish()
    (measured,) = measure(path, regions, [(site, bin_settings(settings))])
    found = solve(measured.history, regions, settings)
    assert [repr(one) for one in found] == [repr(one) for minute in minutes for one in minute.estimates]
    assert names not in TOGETHER or np.isfinite(found.rows["tilt_deg"]).any()
    assert found.rows["irradiance_w_m2"][::3].tolist() == pytest.approx(
        [minute.dni_w_m2 for minute in minutes], nan_ok=True, abs=0
    )


def test_kept_minutes_hold_air_and_probes_as_they_were_live(recording):
    path, site, regions, streams, samples = recording
    with open_session(path) as session:
        settings = config_for(session).estimator_settings()
    probes = {"flat": "thermometer:T1", "b05": "thermometer:T2", "b15": "thermometer:T3"}
    assert settings.probes == {region: (probe,) for region, probe in probes.items()}
    estimator = Estimator(site, regions, streams, settings)
    for sample in samples:
        estimator.add(sample)
    estimator.finish()
    live = estimator.history
    (measured,) = measure(path, regions, [(site, bin_settings(settings))])
    kept = measured.history
    for name in ("air_k", "wind_m_s", "probe_k"):
        assert getattr(live, name).tobytes() == getattr(kept, name).tobytes()
    # NOAA, SURFRAD, slv16001.dat: -6.6 to -6.1 °C from 19:00 to 19:12 UTC
    assert np.abs(kept.air_k - 273.15 + 6.35).max() < 0.35
    assert np.isnan(kept.wind_m_s).all()
    assert np.isnan(kept.probe_k[:, 3]).all()  # three probes, four beds
    assert np.isfinite(kept.probe_k[:, :3]).all()
    assert np.nanmax(np.abs(kept.probe_k - kept.temperature_k)) < 1.0


def test_one_reading_serves_several_settings(recording):
    path, site, regions, _, _ = recording
    one, other = EstimatorSettings(), EstimatorSettings(surface=SurfaceParameters(emissivity=0.8))
    wanted = [(site, bin_settings(one)), (site, bin_settings(other))]
    both = [found.history for found in measure(path, regions, wanted)]
    assert np.nanmean(both[0].temperature_k) < np.nanmean(both[1].temperature_k)
    (alone,) = measure(path, regions, wanted[1:])
    assert alone.history.temperature_k.tobytes() == both[1].temperature_k.tobytes()


def test_a_file_that_is_no_session_is_a_session_error(tmp_path, recording):
    (tmp_path / "no.h5").write_text("nothing")
    with pytest.raises(SessionError):
        measure(tmp_path / "no.h5", recording[2], [])
