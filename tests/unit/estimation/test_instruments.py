from dataclasses import replace

import numpy as np
import pandas
import pvlib
import pytest

from fieldkit.estimation.binner import Binner
from fieldkit.estimation.bins import History, MinuteBin, OpenBin
from fieldkit.estimation.instruments import Instruments
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Quality, Reading
from fieldkit.model.site import Region, RegionKind
from fieldkit.physics.daylight import clear_sky, sky_view
from fieldkit.physics.facet import normal
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.sun import sun_vectors
from fieldkit.weather import packaged_day
from tests.harness.next_steps import at
from tests.harness.papers_field import SITE, utc_ns

METERS = {
    "pyrheliometer": IrradianceModel(kind="pyrheliometer"),
    "sun-pointing": IrradianceModel(kind="calibrated", factor=1.0, mounting="sun-pointing"),
    "in-plane": IrradianceModel(
        kind="calibrated", factor=1.0, mounting="in-plane", plane_tilt_deg=30.0, plane_azimuth_deg=180.0
    ),
    "horizontal": IrradianceModel(kind="calibrated", factor=1.0),
}


def cloudless(meter: str, time_ns: np.ndarray) -> np.ndarray:
    """What a meter reads from night to night under a clear sky."""
    sun = sun_vectors(time_ns, SITE, refraction=True)
    beam, sky = clear_sky(sun[:, 2], time_ns, SITE.elevation_m)
    if meter == "pyrheliometer":
        return beam
    if meter == "sun-pointing":
        return 108.0 * beam + 130.0 * sky * sky_view(sun[:, 2])
    facet = normal(30.0, 180.0) if meter == "in-plane" else normal(0.0, 0.0)
    return 108.0 * beam * np.maximum(sun @ facet, 0.0) + 130.0 * sky * sky_view(facet[2])


def closed_bins(binner, samples):
    """What a binner closes of (stream, nanoseconds, value), and the events with it."""
    closed = []
    for name, at_ns, value in samples:
        closed += binner.add(Reading(name, at_ns, at_ns, (value,)))
    closed += binner.finish()
    return [entry for entry, _ in closed], [event for _, events in closed for event in events]


@pytest.mark.parametrize("meter", METERS)
@pytest.mark.parametrize("start", ["2017-08-29T19:30", "2017-12-10T21:00"])
def test_a_cloudless_day_from_before_sunrise_has_no_clouds(meter, start):
    time_ns = utc_ns(start) + np.arange(0, 14 * 3600, 30) * 10**9
    quantity, unit = ("irradiance", "W m-2") if meter == "pyrheliometer" else ("illuminance", "lx")
    streams = (StreamInfo("light", quantity, unit, (1,), measures=("dni",) if unit == "W m-2" else ()),)
    binner = Binner(SITE, (), streams, EstimatorSettings(irradiance=METERS[meter]))
    light = cloudless(meter, time_ns)
    bins, events = closed_bins(binner, (("light", *row) for row in zip(time_ns.tolist(), light, strict=True)))
    assert len(bins) == 14 * 60
    assert not any(entry.flags & Quality.CLOUD for entry in bins)
    assert not events


# --- air and probes


THERMOMETER = StreamInfo(
    "thermometer", "temperature", "K", (4,), channels=("T1", "T2", "T3", "air"), rate_hz=1.0
)
REGIONS = tuple(
    Region(name, kind, ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)))
    for name, kind in (("flat", RegionKind.REFERENCE), ("b15", RegionKind.TARGET), ("b25", RegionKind.TARGET))
)


def binned(streams, readings, **settings) -> list[MinuteBin]:
    """Bins of readings given as (stream, second, values, quality)."""
    binner = Binner(SITE, REGIONS, streams, EstimatorSettings(**settings))
    closed = []
    for name, second, values, quality in readings:
        at_ns = AT_22_DEGREES + second * 10**9
        closed += binner.add(Reading(name, at_ns, at_ns, values, quality=quality))
    return [entry for entry, _ in closed + binner.finish()]


def test_air_and_probes_are_the_means_of_their_channels_without_unusable_readings():
    readings = [
        ("thermometer", 0, (300.0, 310.0, 320.0, 290.0), Quality.GOOD),
        ("thermometer", 1, (302.0, np.nan, 324.0, 292.0), Quality.GOOD),
        ("thermometer", 2, (900.0, 900.0, 900.0, 900.0), Quality.STALE),
        ("logger", 3, (305.0,), Quality.GOOD),
    ]
    logger = StreamInfo("logger", "temperature", "K", (1,), channels=("bed",))
    probes = {"flat": ("thermometer:T1",), "b25": ("thermometer:3", "logger:bed", "lost:T1")}
    (entry,) = binned((THERMOMETER, logger), readings, probes=probes)
    assert entry.air_k == 291.0
    assert np.isnan(entry.wind_m_s)
    # b25: the mean of (320 + 324) / 2 and 305
    np.testing.assert_allclose(entry.probe_k, [301.0, np.nan, 313.5])
    assert entry.contact_k[:4] == (301.0, 310.0, 322.0, 291.0)


def test_without_configured_probes_or_names_nothing_is_guessed():
    unnamed = replace(THERMOMETER, channels=("T1", "T2", "T3", "T4"))
    (entry,) = binned((unnamed,), [("thermometer", 0, (300.0, 310.0, 320.0, 290.0), Quality.GOOD)])
    assert np.isnan(entry.air_k)
    assert entry.probe_k.size == 0
    assert np.isnan(History.of([entry]).probe_k).all()


def test_a_stations_air_and_wind_are_those_of_its_file():
    """NOAA, SURFRAD, slv16001.dat: -7.6 °C and 3.1 m/s in the line of 2016-01-01 00:00 UTC."""
    day = packaged_day()
    at_ns = int(day.time_ns[0])
    streams = (
        StreamInfo("slv-air", "air_temperature", "K", (1,), rate_hz=1 / 60),
        StreamInfo("slv-wind", "wind_speed", "m s-1", (1,), rate_hz=1 / 60),
    )
    binner = Binner(day.site, (), streams, EstimatorSettings())
    values = {"slv-air": float(day.air_temperature_k[0]), "slv-wind": float(day.wind_m_s[0])}
    (entry,), _ = closed_bins(binner, ((name, at_ns, value) for name, value in values.items()))
    assert (entry.air_k, entry.wind_m_s) == (pytest.approx(265.55), 3.1)


def test_a_thermometer_in_the_field_is_used_before_hourly_means_of_a_station():
    hourly = StreamInfo("jma-air", "air_temperature", "K", (1,), rate_hz=1 / 3600)
    readings = [
        ("jma-air", 0, (280.0,), Quality.GOOD),
        ("thermometer", 1, (300.0, 310.0, 320.0, 290.0), Quality.GOOD),
    ]
    (entry,) = binned((hourly, THERMOMETER), readings)
    assert entry.air_k == 290.0


def test_hourly_values_stand_until_the_next_are_due():
    streams = (
        StreamInfo("jma-air", "air_temperature", "K", (1,), rate_hz=1 / 3600),
        StreamInfo("jma-wind", "wind_speed", "m s-1", (1,), rate_hz=1 / 3600),
        StreamInfo("logger", "temperature", "K", (1,), rate_hz=1 / 900),
        radiation("df", "dhi", 1 / 3600),
        radiation("dl", "longwave_down", 1 / 3600),
        LUX,
    )
    hourly = {"jma-air": 280.0, "jma-wind": 3.5, "logger": 305.0, "df": 83.0, "dl": 290.0}
    readings = [("lux", 60 * minute, (40_000.0,), Quality.GOOD) for minute in range(120)]
    readings[10:10] = [(name, 600, (value,), Quality.GOOD) for name, value in hourly.items()]
    history = History.of(binned(streams, readings, probes={"flat": ("logger:1",)}))
    for values, held, last in (
        (history.air_k, 280.0, 100),  # one and a half of its own intervals
        (history.wind_m_s, 3.5, 100),
        (history.dhi_w_m2, 83.0, 100),
        (history.longwave_down_w_m2, 290.0, 100),
        (history.probe_k[:, 0], 305.0, 32),  # 22.5 min
    ):
        assert np.isnan(values[:10]).all()
        assert (values[10 : last + 1] == held).all()
        assert np.isnan(values[last + 1 :]).all()


@pytest.mark.parametrize(
    ("probe", "message", "fix"),
    [
        ("thermometer:T9", "'T9'", "thermometer: T1, T2, T3, air"),
        ("thermometer:0", "'0'", "T1"),
        ("lux:1", "lux measures illuminance", "name a thermometer: thermometer"),
        ("thermometer:air", "thermometer:air", "labels"),
    ],
)
def test_probes_that_contradict_the_streams_are_refused_with_what_there_is(probe, message, fix):
    with pytest.raises(ConfigError, match=message, check=at("region flat")) as caught:
        Instruments((THERMOMETER, LUX), EstimatorSettings(probes={"flat": (probe,)}))
    assert fix in caught.value.fix


def test_probes_of_a_stream_that_was_not_recorded_are_reported_once():
    binner = Binner(SITE, REGIONS, (LUX,), EstimatorSettings(probes={"flat": ("thermometer:T1",)}))
    bins, (event,) = closed_bins(binner, THREE_MINUTES)
    assert event.data == {"absent": "thermometer"}
    assert all(np.isnan(entry.probe_k).tolist() == [True] * 3 for entry in bins)


# --- which stream gives the light, and what it is

AT_22_DEGREES = utc_ns("2017-12-11T00:09")
"""At SITE the sun stands 22 degrees high (SPA)."""
THREE_MINUTES = [("lux", AT_22_DEGREES + minute * 60_000_000_000, 40_000.0) for minute in range(3)]


def radiation(name: str, component: str = "", rate_hz: float = 1.0, **more: object) -> StreamInfo:
    measures = (component,) if component else ()
    return StreamInfo(name, "irradiance", "W m-2", (1,), measures=measures, rate_hz=rate_hz, **more)


DEFAULTS = EstimatorSettings()
LUX = StreamInfo("lux", "illuminance", "lx", (1,), rate_hz=1.0)
GLOBAL = radiation("k", "ghi")


def chosen(*streams: StreamInfo, **settings: object) -> str:
    source = Instruments(streams, EstimatorSettings(**settings)).light_source
    return source.info.name if source else ""


def beam(readings: dict[str, float], *streams: StreamInfo, settings: EstimatorSettings = DEFAULTS) -> float:
    """Direct normal irradiance of a minute with one reading of each stream at 22 degrees of sun."""
    instruments = Instruments(streams, settings)
    minute = OpenBin(AT_22_DEGREES // 60_000_000_000, np.arange(0))
    for name, value in readings.items():
        minute.add_reading(Reading(name, AT_22_DEGREES, AT_22_DEGREES, (value,)))
    (found,) = instruments.light(minute, SITE, settings).dni_w_m2
    return float(found)


@pytest.mark.parametrize("global_w_m2", [120.0, 250.0, 400.0])
def test_global_light_by_erbs_gives_the_beam_of_pvlib(global_w_m2):
    time = pandas.DatetimeIndex([pandas.Timestamp(AT_22_DEGREES, tz="UTC")])
    zenith = pvlib.solarposition.get_solarposition(time, SITE.latitude_deg, SITE.longitude_deg, 9.0)["zenith"]
    expected = float(pvlib.irradiance.erbs(global_w_m2, zenith, time.day_of_year)["dni"][0])
    settings = EstimatorSettings(irradiance=IrradianceModel(diffuse="erbs"))
    # the solar constant of 1982 is 0.4 % larger
    assert beam({"sun": global_w_m2}, radiation("sun", "ghi"), settings=settings) == pytest.approx(
        expected, rel=0.02
    )


def test_global_light_less_measured_diffuse_light_is_the_measured_beam():
    """Three instruments of SURFRAD, Alamosa: a closed day of sun, minute by minute."""
    day = packaged_day()
    streams = (radiation("slv-diffuse", "dhi", 1 / 60), radiation("slv-global", "ghi", 1 / 60))
    binner = Binner(day.site, (), streams, EstimatorSettings())
    columns = {"slv-diffuse": day.dhi_w_m2, "slv-global": day.ghi_w_m2}
    rows = enumerate(day.time_ns.tolist())
    samples = ((name, at_ns, float(column[row])) for row, at_ns in rows for name, column in columns.items())
    bins, _ = closed_bins(binner, samples)
    high = np.array([entry.sun[2] > 0.35 for entry in bins])
    ratio = np.array([entry.dni_w_m2 for entry in bins])[high] / day.dni_w_m2[high]
    assert high.sum() > 200
    assert np.median(ratio) == pytest.approx(1.0, abs=0.02)
    assert np.array([entry.dhi_w_m2 for entry in bins])[high] == pytest.approx(day.dhi_w_m2[high])
    assert binner.irradiance_model.startswith("pyranometer, ")
    assert binner.irradiance_model.endswith(", dhi as measured")


def test_tilted_pyranometer_goes_through_its_own_plane():
    plane = IrradianceModel(mounting="in-plane", plane_tilt_deg=68.0, plane_azimuth_deg=180.0)
    facing = float(normal(68.0, 180.0) @ sun_vectors(AT_22_DEGREES, SITE))
    # E = S cos i + D (1 + cos 68) / 2 with D the 15 % of the global horizontal light
    sky = 0.15 / 0.85 * np.sin(np.radians(22.0)) * (1.0 + np.cos(np.radians(68.0))) / 2.0
    # and of the ground 0.2 (S sin 22 + D) (1 - cos 68) / 2
    ground = 0.2 * np.sin(np.radians(22.0)) / 0.85 * (1.0 - np.cos(np.radians(68.0))) / 2.0
    reading = 800.0 * (facing + sky + ground)
    settings = EstimatorSettings(irradiance=plane)
    assert beam({"sun": reading}, radiation("sun", "gti"), settings=settings) == pytest.approx(
        800.0, rel=2e-3
    )


@pytest.mark.parametrize("first", ["sun", "shaded", "pyrgeometer"])
def test_radiation_of_unknown_kind_asks_for_the_key_that_names_it(first):
    info = replace(radiation(first), driver="text")
    with pytest.raises(ConfigError, check=at(first)) as caught:
        Instruments((info,), EstimatorSettings())
    assert f"irradiance.measures.{first}" in caught.value.fix
    stated = EstimatorSettings(measures={first: "dni"})
    assert chosen(info, measures={first: "dni"}) == first
    assert beam({first: 700.0}, info, settings=stated) == pytest.approx(700.0)


def test_beside_a_light_meter_unknown_radiation_is_left_alone_with_a_warning_once():
    binner = Binner(SITE, (), (radiation("sun"), LUX), EstimatorSettings())
    assert binner.irradiance_model.startswith("eq10")
    _, (event,) = closed_bins(binner, THREE_MINUTES)
    assert event.stream == "sun"
    assert "irradiance.measures.sun" in event.text
    assert len(event.text) <= 256  # what an event has room for


def test_direct_wins_over_global_over_tilted_over_lux_whatever_came_first():
    tilted = IrradianceModel(mounting="in-plane", plane_tilt_deg=30.0, plane_azimuth_deg=180.0)
    rising = [LUX, radiation("t", "gti"), radiation("g", "ghi"), radiation("d", "dni")]
    for best in range(1, 5):
        assert chosen(*rising[:best], irradiance=tilted) == rising[best - 1].name
    assert chosen(*rising, irradiance=tilted, light_stream="lux") == "lux"
    assert chosen(light_stream="lux") == ""  # frames alone
    assert chosen(radiation("sky", "dhi"), radiation("lw", "longwave_down"), LUX) == "lux"
    assert chosen(radiation("sky", "dhi"), radiation("lw", "longwave_up")) == ""


def test_hourly_means_of_a_station_do_not_take_the_place_of_a_light_meter():
    hourly = radiation("jma-direct", "dni", 1 / 3600)
    assert chosen(hourly, LUX) == "lux"
    assert chosen(hourly) == "jma-direct"


@pytest.mark.parametrize(
    ("stream", "settings", "place", "key"),
    [
        (LUX, {"light_stream": "kipp"}, "irradiance.stream", "lux"),
        (LUX, {"measures": {"lux": "ghi"}}, "irradiance.measures.lux", "irradiance.model"),
        (radiation("k", "gti"), {}, "irradiance.mounting", "plane_tilt_deg"),
        (GLOBAL, {"irradiance": IrradianceModel("pyrheliometer")}, "irradiance.model", "measures.k"),
        (GLOBAL, {"irradiance": IrradianceModel(diffuse="none")}, "irradiance.diffuse", "erbs"),
    ],
)
def test_what_contradicts_the_streams_is_refused_with_the_key_to_set(stream, settings, place, key):
    with pytest.raises(ConfigError, check=at(place)) as caught:
        Instruments((stream,), EstimatorSettings(**settings))
    assert key in caught.value.fix


def test_model_of_a_pyrheliometer_states_what_a_stream_does_not_say():
    direct = EstimatorSettings(irradiance=IrradianceModel(kind="pyrheliometer"))
    assert beam({"sun": 650.0}, radiation("sun"), settings=direct) == pytest.approx(650.0)


@pytest.mark.parametrize("start", ["2017-08-30T02:30", "2017-12-11T02:30"])
def test_a_cloud_before_a_high_or_a_low_noon_sun_is_seen(start):
    time_ns = utc_ns(start) + np.arange(0, 1800, 10) * 10**9
    light = cloudless("horizontal", time_ns)
    light[60:90] *= 0.6
    binner = Binner(SITE, (), (StreamInfo("light", "illuminance", "lx", (1,)),), EstimatorSettings())
    bins, _ = closed_bins(binner, (("light", *row) for row in zip(time_ns.tolist(), light, strict=True)))
    flagged = [bool(entry.flags & Quality.CLOUD) for entry in bins]
    assert flagged[:10] == [False] * 10
    assert all(flagged[10:16])
