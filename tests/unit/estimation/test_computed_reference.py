"""References that were computed from the weather, beside measured ones, and tables that have them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import real
from benchmarks.drawn_worlds import AUGUST, CLEAR
from fieldkit.estimation.bins import join
from fieldkit.estimation.computed_reference import require_measured_reference
from fieldkit.model.errors import ConfigError
from fieldkit.model.units import MINUTE_NS
from fieldkit.results.estimate import estimate_tables
from fieldkit.weather import packaged_day
from tests.harness.drawn import drawn_world, later, write_table
from tests.harness.next_steps import at
from tests.shared_data import shared

MODULE = "data/real/pv-module-2016-jul-sep.csv"
TWIN = "data/real/twinhouse-o5-2013-aug-sep.csv"


def of_light(history):
    """A handbook's plate: 0.0226 K over the air for each W/m2 of global light (D. Faiman, 2008, at 3 m/s)."""
    global_w_m2 = history.dni_w_m2 * history.sun[:, 2] + history.dhi_w_m2
    return history.air_k + 0.0226 * global_w_m2


def with_lag(history):
    """The same plate, which follows within five minutes."""
    level = of_light(history)
    kelvin = level.copy()
    for row in range(1, kelvin.size):
        kelvin[row] = kelvin[row - 1] + (level[row] - kelvin[row - 1]) * (1.0 - np.exp(-1.0 / 5.0))
    return kelvin


def with_reference(history, kelvin):
    return replace(history, temperature_k=np.column_stack([kelvin, history.temperature_k[:, 1:]]))


WORLDS = {sky: drawn_world(2, sky, minutes=60) for sky in (CLEAR, AUGUST)}


@pytest.mark.parametrize("computed", [of_light, with_lag, lambda day: of_light(day).round(3)])
@pytest.mark.parametrize("sky", WORLDS)
def test_a_reference_computed_from_the_weather_is_refused(sky, computed):
    world = WORLDS[sky]
    require_measured_reference("noon", world.history, world.regions)
    with pytest.raises(ConfigError, match=world.regions[0].name, check=at("noon")):
        require_measured_reference(
            "noon", with_reference(world.history, computed(world.history)), world.regions
        )


def test_few_rows_judge_nothing():
    world = WORLDS[CLEAR]
    few = with_reference(world.history, of_light(world.history)).until(25)
    require_measured_reference("noon", few, world.regions)


def write(path, history):
    reference_k, bed_k, *_ = history.temperature_k.T
    return write_table(path, history, reference_k=reference_k, bed_k=bed_k)


def test_tables_beside_a_computed_reference_are_refused_alone_and_together(tmp_path):
    first = with_reference(WORLDS[CLEAR].history, of_light(WORLDS[CLEAR].history))
    days = [write(tmp_path / f"{number}.csv", later(first, number)) for number in range(2)]
    both, site = write(tmp_path / "both.csv", join([first, later(first)])), packaged_day().site
    keys = ["estimator.model=learned"]
    for tables in (days[:1], days, [both]):
        with pytest.raises(ConfigError, match="computed", check=at(tables[0])):
            estimate_tables(tables, site, settings=keys)
    # the other models learn nothing from it
    assert estimate_tables([days[0]], site, settings=["estimator.model=full"])


def measured_module():
    """Three clear days of a module of 40°, beside its column of the reference, without one."""
    days = list(real._days(real._module(real._columns(shared(MODULE))), real.PV_SITE.longitude_deg))[10:13]
    return [real.as_part("day", day, real.PV_SITE, real.settings_of("plate")).history for day in days]


def measured_wall():
    """Soil under grass beside a wall, ten minutes a row."""
    columns = real._columns(shared(TWIN))
    table = real.TemperatureTable(
        columns["time_cet"].astype(np.int64) - 65 * MINUTE_NS,
        columns["ground_0cm_c"] + 273.15,
        {"wall": columns["west_wall_outside_c"] + 273.15},
        ghi_w_m2=columns["ghi_w_m2"],
        diffuse_w_m2=columns["dhi_w_m2"],
        air_k=columns["air_c"] + 273.15,
        wind_m_s=columns["wind_m_s"],
    )
    settings = real.settings_of("wall", irradiance=real.OF_GHI)
    days = list(real._days(table, real.TWIN_SITE.longitude_deg))[3:9]
    return [real.as_part("day", day, real.TWIN_SITE, settings).history for day in days]


def test_measured_references_are_never_taken_for_computed():
    for day in measured_wall():
        require_measured_reference("day", day, WORLDS[CLEAR].regions[:2])


def test_a_plate_computed_beside_a_measured_module_is_refused():
    for day in measured_module():
        with pytest.raises(ConfigError, match="computed"):
            require_measured_reference("day", with_reference(day, of_light(day)), WORLDS[CLEAR].regions[:2])
