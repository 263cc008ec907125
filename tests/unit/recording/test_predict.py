"""Predicted temperatures, held against the energy balance of the paper's eq. (1), written out here."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import fieldkit
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import Site
from fieldkit.physics.slab import Slab
from fieldkit.physics.sun import sun_vectors
from fieldkit.recording.predict import history_of
from fieldkit.simulation import Exchange
from fieldkit.weather import Weather
from tests.harness.next_steps import at

SITE = Site(35.558675, 139.395232)
NOON_NS = int(np.datetime64("2026-03-21T02:45", "ns").astype(np.int64))
HOUR_NS = 3_600_000_000_000
SIGMA = 5.670374419e-8
LONGWAVE, AIR, EXCHANGE = 320.0, 290.0, 15.0
FOIL = EstimatorSettings(slab=Slab(1e-5, 0.25, 1.3e6), ground_albedo=0.0)
"""Stores next to nothing; nothing is reflected by the ground."""


def constant(middle_ns, dni=0.0, **others):
    values = {"dni": dni, "dhi": 0.0, "longwave": LONGWAVE, "air": AIR, "wind": 2.0} | others
    columns = [np.full(3, value) for value in values.values()]
    return Weather(middle_ns + HOUR_NS * np.arange(-1, 2), *columns, SITE)


def balanced_k(shortwave, exchange=EXCHANGE, longwave=LONGWAVE, albedo=0.2):
    """Eq. (1) with emissivity 0.9: absorbed light and longwave leave as eqs. (4) and (5)."""
    gained = (1 - albedo) * shortwave + 0.9 * longwave
    return brentq(lambda t: gained - 0.9 * SIGMA * t**4 - exchange * (t - AIR), 200.0, 400.0, xtol=1e-10)


def test_without_sun_sand_stays_at_the_temperature_of_the_balance():
    found = fieldkit.predict([(0, 0), (25, 180)], constant(NOON_NS - 12 * HOUR_NS))
    assert found.surface_k.shape == (120, 2)
    assert found.surface_k[:, 0] == pytest.approx(np.full(120, balanced_k(0.0)), abs=1e-6)


def test_a_thin_facet_follows_the_sun_and_is_hotter_facing_it():
    facets = [(0, 0), (35.5, 180), (35.5, 0)]
    found = fieldkit.predict(facets, constant(NOON_NS, 900.0), settings=FOIL)
    cos_zenith = sun_vectors(found.time_ns, SITE, refraction=True)[:, 2]
    expected = [balanced_k(900.0 * cosine) for cosine in cos_zenith]
    assert found.surface_k[1:, 0] == pytest.approx(expected[1:], abs=2e-3)
    flat, south, north = found.surface_k[60]
    assert north < flat < south


def test_a_wall_in_its_own_shade_is_lit_and_warmed_by_the_ground():
    """Half of what a wall sees is level ground of albedo 0.5, half of it sky without diffuse light."""
    settings = replace(FOIL, ground_albedo=0.5)
    found = fieldkit.predict([(90, 0)], constant(NOON_NS, 900.0), settings=settings)
    ghi = 900.0 * sun_vectors(found.time_ns, SITE, refraction=True)[60, 2]
    ground_k = balanced_k(ghi, albedo=0.5)
    from_ground = 0.9 * SIGMA * ground_k**4 + 0.1 * LONGWAVE
    expected = balanced_k(0.5 * ghi / 2, longwave=(LONGWAVE + from_ground) / 2)
    assert found.surface_k[60, 0] == pytest.approx(expected, abs=2e-3)


def test_the_exchange_is_a_number_or_follows_the_wind():
    night = constant(NOON_NS - 12 * HOUR_NS)
    for exchange in (23.0, Exchange(19.0, 2.0)):  # 2 m/s of wind
        found = fieldkit.predict([(0, 0)], night, exchange=exchange)
        assert found.surface_k[-1, 0] == pytest.approx(balanced_k(0.0, 23.0), abs=1e-6)


def test_estimators_take_what_is_predicted():
    start = "2026-03-21T11:15+09:00"
    found = fieldkit.predict([(0, 0), (10, 180)], constant(NOON_NS, 900.0), start=start, minutes=30)
    history = history_of(found, SITE)
    assert len(history) == 30
    assert history.temperature_k is found.surface_k
    assert str(history.time_ns[0].astype("datetime64[ns]"))[:19] == "2026-03-21T02:15:30"


def test_what_cannot_be_predicted_is_refused():
    nan = float("nan")
    for facets in ([], [(nan, 0)], [(15, 180), (91, 180)], [(15, float("inf"))], [(-1, 0)], [(15, 361)]):
        with pytest.raises(ConfigError, check=at(Argument("facets"))):
            fieldkit.predict(facets, constant(NOON_NS))
    for exchange in (nan, -1.0, Exchange(10.0, nan)):
        with pytest.raises(ConfigError, check=at(Argument("exchange"))):
            fieldkit.predict([(0, 0)], constant(NOON_NS), exchange=exchange)
    with pytest.raises(ConfigError, match="2026-03-21"):
        fieldkit.predict([(0, 0)], constant(NOON_NS), start="2026-04-01T00:00Z")
    for minutes in (0, -5, 121):  # beyond its end the sun would shine on as at its end
        with pytest.raises(ConfigError, match=rf"1 to 120 .*{minutes}", check=at(Argument("minutes"))):
            fieldkit.predict([(0, 0)], constant(NOON_NS), minutes=minutes)
    with pytest.raises(ConfigError, match="air_temperature_k"):
        fieldkit.predict([(0, 0)], constant(NOON_NS, air=np.nan))
