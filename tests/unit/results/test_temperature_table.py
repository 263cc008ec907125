"""`fieldkit estimate table.csv`: the golden four hours, independent SPA sun and Table 1 parameters."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pvlib
import pytest

from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.table import as_part, slopes_of_part
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.model.slope import SlopeState
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.results.estimate import estimate_tables, require_slope
from fieldkit.results.temperature_table import read_table
from fieldkit.views import formatting
from tests.harness.command_line import document, fieldkit
from tests.harness.next_steps import at


def slopes_of(path, site, settings, **more):
    return slopes_of_part(as_part("", read_table(path), site, settings, **more))


SITE = Site(35.558675, 139.395232, 9.0)
WHOLE = EstimatorSettings(model="paper", window_s="weather")
CASE_1 = """time,reference_k,bed_k,irradiance_w_m2
2017-08-30T12:00:00+09:00,323.60330,325.23205,800
2017-08-30T13:00:00+09:00,322.50984,324.02574,800
2017-08-30T14:00:00+09:00,320.08268,321.34508,800
2017-08-30T15:00:00+09:00,316.46441,317.34486,800
"""
CASE_2 = """time,reference_k,bed_k,irradiance_w_m2
2017-08-30T09:00:00+09:00,318.65543,321.86850,800
2017-08-30T10:00:00+09:00,321.61792,324.24478,800
2017-08-30T11:00:00+09:00,323.30003,325.14110,800
2017-08-30T12:00:00+09:00,323.60330,324.50615,800
"""
SUN_UP = (0.891975, 0.849206, 0.754695, 0.614874)
"""Cosine of the zenith at these times (SPA)."""


@pytest.fixture
def table(tmp_path):
    def write(text: str):
        path = tmp_path / "table.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(("text", "slope"), [(CASE_1, (10.0, 180.0)), (CASE_2, (12.0, 135.0))])
def test_the_golden_tables_give_their_slopes(table, text, slope):
    (bed,) = slopes_of(table(text), SITE, WHOLE)
    assert (bed.region, bed.n_bins) == ("bed", 4)
    assert (bed.tilt_deg, bed.azimuth_deg) == pytest.approx(slope, abs=0.005)
    assert bed.tilt_low_deg < bed.noise_tilt_low_deg < slope[0] < bed.noise_tilt_high_deg < bed.tilt_high_deg
    if text == CASE_1:
        # 0.064 K per degree at 15:00 (d T / d tilt of a 10 degree south slope, S = 800 instead of 850)
        assert bed.kelvin_per_degree == pytest.approx(0.066 * 800 / 850, abs=0.006)


def test_air_and_wind_are_columns_of_the_table_and_no_targets(table):
    first, *rows = CASE_1.splitlines()
    text = "\n".join([f"{first},air_c,wind_m_s", *(f"{row},22.5,{hour}" for hour, row in enumerate(rows))])
    read = read_table(table(text))
    assert list(read.targets_k) == ["bed"]
    assert read.air_k.tolist() == [295.65] * 4
    assert read.wind_m_s.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert slopes_of(table(text), SITE, WHOLE) == slopes_of(table(CASE_1), SITE, WHOLE)
    with pytest.raises(ConfigError, match="one NAME_k"):
        read_table(table("time,reference_k,air_k,irradiance_w_m2\n2017-08-30T12:00:00+09:00,1,2,3\n"))


def with_light(columns, cells):
    """The golden table with other columns of light, a cell for each hour."""
    first, *rows = CASE_1.splitlines()
    lines = [first.replace("irradiance_w_m2", columns)]
    return "\n".join(
        lines + [f"{row.rsplit(',', 1)[0]},{cell}" for row, cell in zip(rows, cells, strict=True)]
    )


def in_celsius_unsorted_and_in_utc():
    head, *rows = CASE_1.splitlines()
    for row in reversed(rows):
        time, *kelvin, irradiance = row.split(",")
        cells = [f"{float(k) - 273.15:.5f}" for k in kelvin]
        head += "\n" + ",".join([f"2017-08-30T{int(time[11:13]) - 9:02d}:00:00Z", *cells, irradiance])
    return head.replace("_k", "_c")


SAME_SLOPE = {
    "celsius": (in_celsius_unsorted_and_in_utc(), {}),
    "known azimuth": (CASE_1, {"azimuth": "known"}),
    "illuminance": (
        with_light("illuminance_lx", [f"{800 * up * 0.44 * 246.78:.3f}" for up in SUN_UP]),
        {"irradiance": IrradianceModel(diffuse="none")},
    ),
    "global, the sky 100 W/m2": (
        with_light("ghi_w_m2,diffuse_w_m2", [f"{800 * up + 100:.4f},100" for up in SUN_UP]),
        {},
    ),
    "global, the sky 15 % of it": (with_light("ghi_w_m2", [f"{800 * up / 0.85:.4f}" for up in SUN_UP]), {}),
}
"""The golden table in other words: its text, and the settings it needs."""


@pytest.mark.parametrize(("text", "settings"), SAME_SLOPE.values(), ids=SAME_SLOPE)
def test_the_same_hours_in_other_words_give_the_same_slope(table, text, settings):
    (bed,) = slopes_of(table(text), SITE, replace(WHOLE, **settings), azimuths_deg={"bed": 180.0})
    assert bed.tilt_deg == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize(
    ("columns", "model", "place"),
    [
        ("ghi_w_m2", IrradianceModel(diffuse="none"), "irradiance.diffuse"),
        ("illuminance_lx", IrradianceModel(kind="pyrheliometer"), "irradiance.model"),
    ],
)
def test_light_that_the_model_does_not_take_is_refused(table, columns, model, place):
    settings = replace(WHOLE, irradiance=model)
    with pytest.raises(ConfigError, check=at(place)):
        slopes_of(table(with_light(columns, ["500"] * 4)), SITE, settings)


def test_flagged_and_empty_cells_are_left_out(table):
    lines = CASE_1.splitlines()
    flagged = [lines[0] + ",flags", *(line + ",0" for line in lines[1:])]
    flagged.append("2017-08-30T14:30:00+09:00,318.0,340.0,800,32")
    flagged.append("2017-08-30T14:40:00+09:00,,340.0,800,")
    flagged.append(f"2017-08-30T14:50:00+09:00,318.0,340.0,800,{2**32 - 1}")
    (bed,) = slopes_of(table("\n".join(flagged)), SITE, WHOLE)
    assert bed.tilt_deg == pytest.approx(10.0, abs=0.001)
    assert bed.n_bins == 4


@pytest.mark.parametrize("flags", ["-1", "0.5", "4294967296", "inf"])
def test_flags_that_are_no_flags_are_refused_with_their_line(table, flags):
    lines = CASE_1.splitlines()
    flagged = [lines[0] + ",flags", lines[1] + ",32", *(f"{line},{flags}" for line in lines[2:])]
    with pytest.raises(ConfigError, match=f"line 3: flags '{flags}'"):
        read_table(table("\n".join(flagged)))


def with_note(light):
    """The golden table with a column of notes, of which the first row's light and note are given."""
    return CASE_1.replace("irradiance_w_m2", "irradiance_w_m2,note").replace(",800", light, 1)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "missing columns: time; reference_k"),
        ("time,reference_k,bed_k\n", "irradiance_w_m2, ghi_w_m2 or illuminance_lx"),
        ("time,reference_k,irradiance_w_m2\n", "one NAME_k"),
        (CASE_1.splitlines()[0], "no rows"),
        (CASE_1.replace("+09:00", ""), "line 2: time '2017-08-30T12:00:00'"),
        (CASE_1.replace("2017-08-30", "1500-08-30"), "line 2: time '1500-08-30T12:00:00+09:00'"),
        (CASE_1.replace("2017-08-30", "3000-08-30"), "line 2: time '3000-08-30T12:00:00+09:00'"),
        (CASE_1.replace("bed_k", "reference_k"), "reference_k and reference_k"),
        (CASE_1.replace("bed_k", "reference_c"), "reference_k and reference_c"),
        (CASE_1.replace("bed_k", "bed_k,bed_k"), "bed_k and bed_k"),
        (CASE_1.replace("322.50984", "warm"), "line 3: reference_k 'warm'"),
        (with_note(',800,"dry'), "line 5"),
        ("time,irradiance_w_m2,reference_c,b15_c\n2017-08-30T12:00:00+09:00,1022,0,7,9,16,4\n", "line 2: "),
        (CASE_1 + "\n12h,320,warm,800\n", "line 7: time '12h'"),  # lines are counted as an editor does
        (CASE_1 + "\n2017-08-30T18:00+09:00,320,warm,800\n", "line 7: bed_k 'warm'"),
    ],
)
def test_what_is_wrong_with_a_table_is_said_with_its_line(table, text, complaint):
    with pytest.raises(ConfigError, match=r"table\.csv") as caught:
        read_table(table(text))
    assert complaint in str(caught.value)


def test_a_file_that_is_not_there_is_a_config_error(tmp_path):
    with pytest.raises(ConfigError, match="cannot read") as caught:
        read_table(tmp_path / "nothing.csv")
    assert caught.value.fix


@pytest.mark.parametrize(
    "more",
    [
        "2017-08-30T21:00:00+09:00,298.0,297.9,0\n2017-08-30T22:00:00+09:00,297.5,297.4,\n",
        ",,,,\n,,,\n",  # as spreadsheets end
    ],
    ids=["night", "commas"],
)
def test_rows_without_sun_or_any_value_change_nothing(table, more):
    (day,), (both,) = (slopes_of(table(text), SITE, WHOLE) for text in (CASE_1, CASE_1 + more))
    assert both == day


FAR_AWAY = {
    "Sydney, winter": ((-33.9, 151.2, 50.0), "2018-06-21T11:00+10:00", 90),
    "Cape Town, summer, tilted reference": ((-33.9, 18.4, 100.0), "2017-12-30T09:00+02:00", 120),
    "on the tropic, sun overhead": ((23.43, 10.0, 0.0), "2021-06-21T11:00+01:00", 120),
    "Svalbard, night of the polar day": ((78.2, 15.6, 30.0), "2019-06-15T02:00+02:00", 120),
    "McMurdo, sun in the south": ((-77.8, 166.7, 10.0), "2020-12-20T18:00+13:00", 120),
    "over the date line": ((-17.0, 179.99, 0.0), "2022-02-01T07:00+12:00", 240),
}


@pytest.mark.parametrize("place", FAR_AWAY)
def test_slopes_anywhere_on_earth_from_a_sun_that_is_not_ours(table, place):
    """Sun by pvlib's SPA, temperatures by eq. (7) solved here: nothing of the estimator's own."""
    (latitude, longitude, elevation), begin, minutes = FAR_AWAY[place]
    reference = (35.0, 320.0) if "tilted" in place else (0.0, 0.0)
    times = pd.date_range(begin, periods=minutes + 1, freq="1min")
    sun = pvlib.solarposition.spa_python(times, latitude, longitude, elevation)
    zenith, azimuth = np.radians(sun["zenith"].to_numpy()), np.radians(sun["azimuth"].to_numpy())

    def kelvin(tilt_deg: float, azimuth_deg: float) -> np.ndarray:
        tilt, facing = np.radians([tilt_deg, azimuth_deg])
        cosine = np.cos(tilt) * np.cos(zenith) + np.sin(tilt) * np.sin(zenith) * np.cos(azimuth - facing)
        warm = np.full(cosine.shape, 300.0)
        for _ in range(50):  # Newton on the paper's eq. (7), Table 1, air 295 K, long wave 330 W/m2
            excess = 0.8 * 800.0 * np.maximum(cosine, 0.0) + 0.9 * 330.0
            excess -= 0.9 * 5.670374419e-8 * warm**4 + 18.15 * (warm - 295.0)
            warm = warm + excess / (4 * 0.9 * 5.670374419e-8 * warm**3 + 18.15)
        return warm

    truths = {"a": (7.3, 151.0), "b": (18.7, 263.0), "c": (26.2, 12.0)}
    columns = {"time": [time.isoformat() for time in times], "reference_k": kelvin(*reference)}
    columns |= {f"{name}_k": kelvin(*truth) for name, truth in truths.items()}
    text = pd.DataFrame({**columns, "irradiance_w_m2": 800.0}).to_csv(index=False)
    site = Site(latitude, longitude, elevation)
    found = slopes_of(table(text), site, WHOLE, reference_slope_deg=reference)
    assert {one.region for one in found} == set(truths)
    for one in found:
        true_tilt, true_azimuth = truths[one.region]
        assert one.tilt_deg == pytest.approx(true_tilt, abs=0.01)
        assert one.azimuth_deg == pytest.approx(true_azimuth, abs=0.03)
        assert one.chi_square >= 0.0


@pytest.mark.parametrize(
    ("column", "cell"),
    [("reference_k", "-26.0"), ("bed_k", "-7725.85"), ("bed_k", "8272.15")]
    + [("irradiance_w_m2", cell) for cell in ("9.9E+37", "-6999", "7999")],
)
def test_a_cell_that_cannot_be_is_as_an_empty_one_and_is_named_by_its_line(table, column, cell):
    head, *rows = CASE_1.splitlines()
    place = head.split(",").index(column)

    def with_cell(text: str) -> str:
        cells = rows[1].split(",")
        return "\n".join([head, rows[0], ",".join([*cells[:place], text, *cells[place + 1 :]]), *rows[2:]])

    told: list[str] = []
    settings = ["estimator.model=paper", "estimator.window_s=86400"]
    found = estimate_tables([table(with_cell(cell))], SITE, settings=settings, notify=told.append)
    (text,) = told
    assert f"{column}: 1 " in text
    assert f"{float(cell):.6g}" in text
    assert "at line 3;" in text
    empty = estimate_tables([table(with_cell(""))], SITE, settings=settings, notify=told.append)
    assert repr(found) == repr(empty)
    assert len(told) == 1


def test_light_of_a_table_in_another_zone_is_refused_and_said(table):
    """Stamps of UTC taken for those of Japan: the sun is down in half of its rows, or never so high."""
    told: list[str] = []
    path = table(CASE_1.replace("+09:00", "-03:00"))
    (bed,) = estimate_tables([path], SITE, settings=["estimator.model=paper"], notify=told.append)
    assert bed.state is SlopeState.LOW_SUN or bed.state is SlopeState.NO_DATA
    assert "irradiance_w_m2: 4 implausible, not used" in told[0]


def test_a_hot_plate_is_possible_where_the_limits_say_so(table):
    hot = CASE_1.replace("325.23205", "455.0")
    told: list[str] = []
    paper = ["estimator.model=paper"]
    estimate_tables([table(hot)], SITE, settings=paper, notify=told.append)
    assert len(told) == 1
    settings = [*paper, "limits.surface_temperature_c=[-50, 250]"]
    estimate_tables([table(hot)], SITE, settings=settings, notify=told.append)
    assert len(told) == 1


def test_one_row_gives_the_component_along_the_sun(table):
    """The golden 15:00: 10 degrees to the south, sun at 251.59 (SPA), so atan(tan 10 cos 71.59) = 3.19."""
    one = "\n".join([CASE_1.splitlines()[0], CASE_1.splitlines()[-1]])
    (bed,) = estimate_tables([table(one)], SITE, settings=["estimator.model=paper"])
    assert (bed.state, bed.n_bins) == (SlopeState.TOO_FEW, 1)
    assert bed.along_sun_low_deg < 3.19 < bed.along_sun_high_deg
    assert bed.along_sun_deg == pytest.approx(3.19, abs=1.0)
    require_slope([bed])
    assert formatting.state(bed).startswith(f"{bed.along_sun_deg:.1f}° ")


OF_SITE = ("--site", "35.558675,139.395232,9")


def test_the_reference_may_slope(table):
    """Reference and target exchanged: the flat one is found from the tilted one."""
    text = CASE_1.replace("reference_k,bed_k", "bed_k,reference_k")
    options = ("--reference-facet", "10,180", "--set", "estimator.model=paper")
    (bed,) = document("estimate", table(text), *OF_SITE, *options)["slopes"]
    assert bed["tilt_deg"] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ((), "--site"),
        ((*OF_SITE, "b.csv"), "--together"),
        ((*OF_SITE, "x.h5"), "--together"),
        ((*OF_SITE, "x.h5", "--together"), "--together"),
        ((*OF_SITE, "-o", "out"), "--json > FILE"),  # the slopes of a table go into no file
        ((*OF_SITE, "--campaign"), "--site"),
        ((*OF_SITE, "-j", 2), "--site"),
    ],
)
def test_what_a_table_does_not_take_is_wrong_usage(table, words, option):
    done = fieldkit("estimate", table(CASE_1), *words)
    assert done.exit_code == 2
    assert option in done.stderr
