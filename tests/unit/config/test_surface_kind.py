"""A kind of surface: what it changes, what wins over it, and what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import fieldkit
from fieldkit.config import ConfigMistakesError, changed_config, config_from_text
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.surface_kinds import KINDS, Kind
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import CERTAIN, WITH_SLOPE, SlopeState
from fieldkit.recording.predict import history_of
from fieldkit.weather import packaged_day
from tests.harness.next_steps import at

ALL_KINDS = r'"sand", .*"forest"'
HERE = Path("fieldkit.toml")
SITE = "[site]\nlatitude_deg = 37.7\nlongitude_deg = -105.92\nelevation_m = 2317\n"


def config(text="", *settings):
    return config_from_text(SITE + text, HERE, settings=settings)


def test_sand_is_what_holds_without_a_kind():
    settings = config().estimator_settings()
    of_sand = config('[surface]\nkind = "sand"\n').estimator_settings()
    assert repr(of_sand) == repr(settings)  # NaN is equal to NaN
    tables = config().tables.model_dump()
    for table, values in KINDS["sand"].defaults().items():
        assert {key: tables[table][key] for key in values} == values


@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_kind_is_a_valid_configuration_with_its_own_priors(kind):
    settings = config(f'[surface]\nkind = "{kind}"\n').estimator_settings()
    known = KINDS[kind]
    assert settings.prior.exchange_w_m2_k == known.exchange_w_m2_k
    assert settings.surface.albedo == known.albedo
    assert settings.slab.depth_m == known.depth_m
    # the models paper and full have the same exchange, but for the paper's own of sand
    expected = 18.15 if kind == "sand" else known.exchange_w_m2_k
    assert settings.surface.exchange_w_m2_k == pytest.approx(expected, rel=5e-3)


def test_kinds_agree_with_published_values():
    # Oke (1987), tables 1.1, 2.1 and 7.4: albedo, and thermal admittance in J m-2 K-1 s-1/2
    albedo = {"soil": (0.05, 0.40), "snow": (0.40, 0.95), "vegetation": (0.16, 0.26), "forest": (0.05, 0.20)}
    inertia = {"soil": (600, 2550), "rock": (2000, 2500), "wall": (1065, 1785), "snow": (130, 595)}
    # plate on a rack and forest: measured (25 to 35, 40 to 60 W m-2 K-1)
    exchange = {"plate": (25, 35), "forest": (40, 60)}
    settings = {kind: config(f'[surface]\nkind = "{kind}"\n').estimator_settings() for kind in KINDS}
    for kind, (low, high) in albedo.items():
        assert low <= settings[kind].surface.albedo <= high
    for kind, (low, high) in inertia.items():
        assert low <= settings[kind].slab.thermal_inertia <= high
    for kind, (low, high) in exchange.items():
        assert low < settings[kind].prior.exchange_w_m2_k < high


def test_steep_kinds_may_be_vertical():
    limits = {kind: config(f'[surface]\nkind = "{kind}"\n').tables.estimator.tilt_limit_deg for kind in KINDS}
    assert {kind for kind, limit in limits.items() if limit == 90.0} == {"plate", "wall"}
    assert set(limits.values()) == {45.0, 90.0}


def test_explicit_keys_win_over_the_kind():
    text = '[surface]\nkind = "snow"\nalbedo = 0.6\n[prior]\nexchange_w_m2_k = 5.0\n[slab]\ndepth_m = 0.5\n'
    settings = config(text, "estimator.tilt_limit_deg=30").estimator_settings()
    assert settings.surface.albedo == 0.6
    assert (settings.prior.exchange_w_m2_k, settings.prior.gain_sd) == (5.0, KINDS["snow"].gain_sd)
    assert settings.slab.depth_m == 0.5
    assert settings.slab.conductivity_w_m_k == KINDS["snow"].conductivity_w_m_k
    assert settings.tilt_limit_deg == 30.0


def test_a_stated_albedo_narrows_the_gain_of_a_wall():
    by_kind, stated = (config(f'[surface]\nkind = "wall"\n{key}') for key in ("", "albedo = 0.77\n"))
    assert (by_kind.tables.prior.gain_sd, stated.tables.prior.gain_sd) == (0.5, 0.15)
    again = config_from_text(stated.to_toml(), HERE, settings=["surface.kind=snow"])
    assert (again.tables.prior.gain_sd, again.tables.surface.albedo) == (KINDS["snow"].gain_sd, 0.77)


def test_a_recorded_session_is_estimated_as_another_kind():
    """A session states every value that was used: those of its kind give way, others do not."""
    stored = config("[prior]\nexchange_log_sd = 0.3\n").to_toml()
    plate = config_from_text(stored, HERE, settings=["surface.kind=plate"])
    assert plate.tables.prior.exchange_w_m2_k == KINDS["plate"].exchange_w_m2_k
    assert plate.tables.prior.exchange_log_sd == 0.3
    again = config_from_text(plate.to_toml(), HERE)
    assert again.tables == plate.tables
    back = changed_config(plate, ["surface.kind=sand"])
    assert back.tables == config_from_text(stored, HERE).tables


def test_what_is_set_with_another_kind_stays_also_where_sand_has_the_same():
    stored = config().to_toml()
    settings = ["surface.albedo=0.2", "surface.kind=snow"]
    assert config_from_text(stored, HERE, settings=settings).tables.surface.albedo == 0.2


def test_an_unknown_kind_is_refused_with_the_list():
    with pytest.raises(ConfigMistakesError, match=ALL_KINDS, check=at("fieldkit.toml:6: surface.kind")):
        config('[surface]\nkind = "ice"\n')


def test_kinds_belong_to_the_earth():
    mars = SITE.replace("elevation_m", 'body = "mars"\nelevation_m')
    with pytest.raises(ConfigMistakesError, match="mars", check=at("fieldkit.toml:7: surface.kind")):
        config_from_text(mars + '[surface]\nkind = "rock"\n', HERE)
    stored = config_from_text(mars, HERE)
    assert config_from_text(stored.to_toml(), HERE).tables == stored.tables


REGIONS = """[[region]]
name = "flat"
kind = "reference"
points_px = [[0, 0], [9, 0], [9, 9]]
[[region]]
name = "rocks"
points_px = [[20, 0], [29, 0], [29, 9]]
surface_kind = "{}"
"""


def test_a_region_has_a_kind_of_its_own_and_a_session_keeps_it():
    one = config(REGIONS.format("rock"))
    assert one.estimator_settings().kinds == {"rocks": "rock"}
    assert config_from_text(one.to_toml(), HERE).estimator_settings().kinds == {"rocks": "rock"}
    assert config(REGIONS.format("sand")).estimator_settings().kinds == {}
    wrong = at("fieldkit.toml:12: region[1].surface_kind")
    with pytest.raises(ConfigMistakesError, match=ALL_KINDS, check=wrong):
        config(REGIONS.format("rok"))


def test_a_reference_has_the_kind_of_the_surface():
    text = REGIONS.format("rock").replace('"reference"', '"reference"\nsurface_kind = "rock"')
    wrong = at("fieldkit.toml:8: region[0].surface_kind")
    with pytest.raises(ConfigMistakesError, match="kind of surface", check=wrong):
        config(text)


def two_kinds():
    """Level sand, sand of 15 degrees and a plate of 40 under one measured sky and one wind; the regions."""
    day, plate = packaged_day(), config('[surface]\nkind = "plate"\n').estimator_settings()
    when = {"start": "2016-01-01T09:00-07:00", "minutes": 150}
    sand = config().estimator_settings()
    of_sand = fieldkit.predict([(0, 0), (15, 180)], day, settings=sand, exchange=13.0, **when)
    of_plate = fieldkit.predict([(40, 180)], day, settings=plate, exchange=26.0, **when)
    history, other = (history_of(field, day.site).since(60) for field in (of_sand, of_plate))
    kelvin = np.column_stack([history.temperature_k, other.temperature_k])
    flags = np.zeros(kelvin.shape, np.int64)
    history = replace(
        history, temperature_k=kelvin, region_flags=flags, probe_k=np.full(kelvin.shape, np.nan)
    )
    outline = ((0.0, 0.0),)
    names = {"level": RegionKind.REFERENCE, "bed": RegionKind.TARGET, "plate": RegionKind.TARGET}
    regions = [Region(name, kind, outline) for name, kind in names.items()]
    return history, regions, replace(sand, tilt_limit_deg=90.0)


def test_a_plate_beside_sand_is_found_by_its_kind_alone():
    history, regions, settings = two_kinds()
    with_kind = replace(settings, kinds={"plate": "plate"})
    bed, plate = SlopeChain(regions, with_kind).at_once(history).slopes
    assert plate.state in WITH_SLOPE
    assert plate.tilt_low_deg < 40.0 < plate.tilt_high_deg
    assert bed.tilt_low_deg < 15.0 < bed.tilt_high_deg
    without = SlopeChain(regions, settings).at_once(history).slopes[1]
    assert without.state not in CERTAIN
    assert not without.tilt_low_deg < 40.0 < without.tilt_high_deg
    by_full = SlopeChain(regions, replace(with_kind, model="full")).at(history).slopes
    assert by_full[0].state is not SlopeState.NO_DATA
    assert by_full[1].state is SlopeState.NO_DATA
    assert "model learned" in by_full[1].reason


def test_a_plate_of_40_degrees_reads_near_40():
    """Two plates, one level, under a measured clear sky; their exchange is not the prior's median."""
    plate, day = config('[surface]\nkind = "plate"\n').estimator_settings(), packaged_day()
    when = {"start": "2016-01-01T09:00-07:00", "minutes": 150}
    field = fieldkit.predict([(0, 0), (40, 180)], day, settings=plate, exchange=26.0, **when)
    names = {"level": RegionKind.REFERENCE, "plate": RegionKind.TARGET}
    regions = [Region(name, kind, ((0.0, 0.0),)) for name, kind in names.items()]
    (found,) = SlopeChain(regions, plate).at_once(history_of(field, day.site).since(60)).slopes
    assert found.tilt_deg == pytest.approx(40.0, abs=5.0)
    assert found.tilt_low_deg < 40.0 < found.tilt_high_deg
    assert np.abs(found.azimuth_deg - 180.0) < 6.0
