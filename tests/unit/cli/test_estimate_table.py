"""``fieldkit estimate table.csv``: golden whole chains, S = 800 W/m2, Table 1, eq. (7), geometric sun."""

import pytest

from fieldkit.model.errors import ConfigError
from tests.harness.command_line import document, fieldkit, invoke, succeed

SITE = "35.558675,139.395232,9"
CASES = {
    # tilt 10, azimuth 180 from 12 to 15 h and tilt 12, azimuth 135 from 9 to 12 h, JST, 30 Aug 2017
    (10.0, 180.0): (
        12,
        (325.23205, 324.02574, 321.34508, 317.34486),
        (323.60330, 322.50984, 320.08268, 316.46441),
    ),
    (12.0, 135.0): (
        9,
        (321.86850, 324.24478, 325.14110, 324.50615),
        (318.65543, 321.61792, 323.30003, 323.60330),
    ),
}


def table_of(hour, target, reference, header="time,reference_k,bed_k,irradiance_w_m2"):
    rows = [f"2017-08-30T{hour + n:02d}:00+09:00,{reference[n]},{target[n]},800" for n in range(len(target))]
    return "\n".join([header, *rows]) + "\n"


PAPER = ("--set", "estimator.model=paper")


@pytest.fixture
def path(tmp_path):
    """A table of the first case."""
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[10.0, 180.0]))
    return path


@pytest.mark.parametrize("slope", CASES)
def test_golden_tables_give_their_slope(path, slope):
    path.write_text(table_of(*CASES[slope]))
    (bed,) = document("estimate", path, "--site", SITE, *PAPER)["slopes"]
    assert (bed["tilt_deg"], bed["azimuth_deg"]) == pytest.approx(slope, abs=0.005)
    assert bed["tilt_region_deg"][0] < bed["tilt_noise_region_deg"][0] < slope[0]
    assert slope[0] < bed["tilt_noise_region_deg"][1] < bed["tilt_region_deg"][1]


def test_the_reference_may_slope(path):
    """Reference and target exchanged: the flat one is found from the tilted one."""
    hour, target, reference = CASES[10.0, 180.0]
    path.write_text(table_of(hour, reference, target))
    (bed,) = document("estimate", path, "--site", SITE, "--reference-facet", "10,180", *PAPER)["slopes"]
    assert bed["tilt_deg"] == pytest.approx(0.0, abs=0.01)


def test_decimal_commas_are_refused_instead_of_cut_off(path):
    row = "2017-08-30T12:00:00+09:00,1022,0,7,9,16,4\n"
    path.write_text(f"time,irradiance_w_m2,reference_c,b15_c\n{row}")
    with pytest.raises(ConfigError, match=r"(?s)line 2.*comma"):
        invoke("estimate", path, "--site", SITE)


def test_rows_of_commas_alone_are_blank_however_many(path):
    path.write_text(table_of(*CASES[10.0, 180.0]) + ",,,,\n,,,\n")
    succeed("estimate", path, "--site", SITE, *PAPER)


@pytest.mark.parametrize(
    ("cell", "said"), [("12h", "time '12h'"), ("2017-08-30T18:00+09:00", "bed_k 'warm'")]
)
def test_lines_are_counted_as_an_editor_does(path, cell, said):
    path.write_text(table_of(*CASES[10.0, 180.0]) + f"\n{cell},320,warm,800\n")
    with pytest.raises(ConfigError, match=f"line 7: {said}"):
        invoke("estimate", path, "--site", SITE)


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ((), "--site"),
        (("--site", SITE, "b.csv"), "--together"),
        (("--site", SITE, "x.h5"), "--together"),
        (("--site", SITE, "x.h5", "--together"), "--together"),
        (("--site", SITE, "-o", "out"), "--json > FILE"),  # the slopes of a table go into no file
        (("--site", SITE, "--campaign"), "--campaign"),
        (("--site", SITE, "-j", 2), "workers"),
    ],
)
def test_what_a_table_does_not_take_is_wrong_usage(path, words, option):
    done = fieldkit("estimate", path, *words)
    assert done.exit_code == 2
    assert option in done.stderr
