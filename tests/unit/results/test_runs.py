"""Results are found again only for what they were made of: everything that moves a slope is in their key."""

from dataclasses import fields, replace

import pytest

from fieldkit.config import load_config
from fieldkit.config.template import SIMULATED, campaign_toml
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.results.minutes import Run, bin_settings
from fieldkit.results.sources import Source

OF_MINUTES = {
    "surface": SurfaceParameters(emissivity=0.8),
    "irradiance": IrradianceModel(par_fraction=0.5),
    "refraction": not EstimatorSettings().refraction,
    "reflected_temperature_k": 250.0,
    "low_sun_deg": 12.0,
    "settle_s": 3.0,
    "limits": {"surface_temperature": (200.0, 700.0)},
}
"""Settings that change the minutes themselves."""


@pytest.fixture
def run(tmp_path):
    file = tmp_path / "fieldkit.toml"
    file.write_text(campaign_toml(SIMULATED), encoding="utf-8")
    config = load_config(file)
    return Run(
        Source(tmp_path / "a.h5", "0123", "id", config, config.regions), config.site, EstimatorSettings()
    )


def test_another_session_site_or_region_has_minutes_of_its_own(run):
    source = run.source
    moved = tuple(replace(one, tilt_deg=one.tilt_deg + 1.0) for one in source.regions)
    others = [
        replace(run, source=replace(source, checksum="4567")),
        replace(run, source=replace(source, regions=moved)),
        replace(run, site=replace(run.site, elevation_m=run.site.elevation_m + 1.0)),
    ]
    assert len({one.bins_key for one in (run, *others)}) == 4
    assert len({one.key for one in (run, *others)}) == 4


def test_where_a_session_lies_and_which_run_it_is_does_not_matter(run, tmp_path):
    elsewhere = replace(run, source=replace(run.source, path=tmp_path / "b.h5"), number=7)
    assert elsewhere.key == run.key


@pytest.mark.parametrize("name", OF_MINUTES)
def test_settings_of_minutes_are_in_the_key_of_minutes(run, name):
    other = replace(run, settings=replace(run.settings, **{name: OF_MINUTES[name]}))
    assert other.bins_key != run.bins_key
    assert other.key != run.key


def test_settings_of_slopes_are_in_the_key_of_slopes_alone(run):
    for name, value in (("scale", 1.1), ("window_s", 480.0), ("noise_k", 0.2), ("model", "full")):
        other = replace(run, settings=replace(run.settings, **{name: value}))
        assert other.bins_key == run.bins_key
        assert other.key != run.key


def test_settings_of_minutes_are_those_and_no_others():
    changed = replace(EstimatorSettings(), **OF_MINUTES, scale=1.3, noise_k=0.3)  # type: ignore[arg-type]
    kept = bin_settings(changed)
    plain = EstimatorSettings()
    different = {one.name for one in fields(kept) if getattr(kept, one.name) != getattr(plain, one.name)}
    assert different == set(OF_MINUTES)
