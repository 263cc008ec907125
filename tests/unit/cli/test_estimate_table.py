"""``fieldkit estimate table.csv``: golden whole chains, S = 800 W/m2, Table 1, eq. (7), geometric sun."""

import json

import pytest
from click.testing import CliRunner

from fieldkit.cli.estimate import command
from tests.harness.command_line import fieldkit

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


@pytest.mark.parametrize("slope", CASES)
def test_golden_tables_give_their_slope(tmp_path, slope):
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[slope]))
    done = CliRunner().invoke(command, [str(path), "--site", SITE, "--json", *PAPER])
    assert done.exit_code == 0, done.output
    (bed,) = json.loads(done.stdout)["slopes"]
    assert (bed["tilt_deg"], bed["azimuth_deg"]) == pytest.approx(slope, abs=0.005)
    assert bed["tilt_region_deg"][0] < bed["tilt_noise_region_deg"][0] < slope[0]
    assert slope[0] < bed["tilt_noise_region_deg"][1] < bed["tilt_region_deg"][1]


def test_the_reference_may_slope(tmp_path):
    """Reference and target exchanged: the flat one is found from the tilted one."""
    hour, target, reference = CASES[10.0, 180.0]
    path = tmp_path / "table.csv"
    path.write_text(table_of(hour, reference, target))
    done = CliRunner().invoke(
        command, [str(path), "--site", SITE, "--reference-facet", "10,180", "--json", *PAPER]
    )
    assert json.loads(done.stdout)["slopes"][0]["tilt_deg"] == pytest.approx(0.0, abs=0.01)


def test_a_table_without_its_site_is_a_wrong_usage(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[10.0, 180.0]))
    done = CliRunner().invoke(command, [str(path)])
    assert done.exit_code == 2
    assert "--site" in done.output


@pytest.mark.parametrize("others", [["b.csv"], ["x.h5"], ["x.h5", "--together"]])
def test_several_tables_need_together_and_no_sessions_among_them(tmp_path, others):
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[10.0, 180.0]))
    done = CliRunner().invoke(command, [str(path), "--site", SITE, *others])
    assert done.exit_code == 2
    assert "--together" in done.output


def estimated(path, *arguments):
    return fieldkit("estimate", path, "--site", SITE, *arguments)


def test_decimal_commas_are_refused_instead_of_cut_off(tmp_path):
    path = tmp_path / "table.csv"
    row = "2017-08-30T12:00:00+09:00,1022,0,7,9,16,4\n"
    path.write_text(f"time,irradiance_w_m2,reference_c,b15_c\n{row}")
    done = estimated(path)
    assert done.exit_code == 3
    assert "line 2: " in done.stderr
    assert "with a point, not a comma" in done.stderr


def test_rows_of_commas_alone_are_blank_however_many(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[10.0, 180.0]) + ",,,,\n,,,\n")
    assert estimated(path).exit_code == 0


@pytest.mark.parametrize(
    ("cell", "said"), [("12h", "time '12h'"), ("2017-08-30T18:00+09:00", "bed_k 'warm'")]
)
def test_lines_are_counted_as_an_editor_does(tmp_path, cell, said):
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[10.0, 180.0]) + f"\n{cell},320,warm,800\n")
    done = estimated(path)
    assert done.exit_code == 3
    assert f"line 7: {said}" in done.stderr


def test_the_slopes_of_a_table_are_not_promised_in_a_file(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[10.0, 180.0]))
    done = estimated(path, "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert "--json > FILE" in done.stderr


@pytest.mark.parametrize("option", [("--campaign",), ("-j", 2), ("-o", "results")])
def test_options_for_sessions_are_refused_with_a_table(tmp_path, option):
    path = tmp_path / "table.csv"
    path.write_text(table_of(*CASES[10.0, 180.0]))
    done = estimated(path, *option)
    assert done.exit_code == 2
    assert "for sessions" in done.stderr
