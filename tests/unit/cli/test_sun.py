import json

import pytest
from click.testing import CliRunner

from fieldkit.cli.sun import command
from fieldkit.cli.types import parse_site

PAPER = ["--site", "35.558675,139.395232,9"]


def run(*words: str):
    return CliRunner().invoke(command, list(words))


def test_first_cell_of_table_2_as_json():
    # SPA: zenith 26.87753, azimuth 189.26531, apparent zenith 26.86901, 10 degrees south 17.0785
    done = run(*PAPER, "--at", "2017-08-30T12:00+09:00", "--facet", "10,180", "--json")
    document = json.loads(done.stdout)
    (row,) = document["rows"]
    assert document["schema"] == 1
    assert row["sun_zenith_deg"] == pytest.approx(26.87753, abs=0.003)
    assert row["sun_azimuth_deg"] == pytest.approx(189.26531, abs=0.003)
    assert row["sun_zenith_refracted_deg"] == pytest.approx(26.86901, abs=0.003)
    assert row["facets"][0]["incidence_deg"] == pytest.approx(17.0785, abs=0.003)


def test_several_times_and_facets_make_a_table():
    hours = [word for hour in (12, 13, 14, 15) for word in ("--at", f"2017-12-11T{hour}:00+09:00")]
    facets = [word for tilt in (0, 5, 15, 25) for word in ("--facet", f"{tilt},180")]
    lines = run(*PAPER, *hours, *facets).stdout.splitlines()
    assert len(lines) == 5
    # the last row of the paper's Table 2 at 15 h: 75.9, 72.6, 66.2, 60.2
    assert [round(float(word[:-1]), 1) for word in lines[-1].split()[-4:]] == [75.9, 72.6, 66.2, 60.2]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--at", "2017-08-30T12:00"], "has no time zone"),
        (["--at", "noon"], "2017-08-30T12:00+09:00"),
        (["--at", "2017-08-30T03:00Z", "--facet", "180,10"], "tilt first"),
        (["--at", "2017-08-30T03:00Z", "--facet", "10"], "TILT,AZIMUTH"),
        (["--at", "2017-08-30T03:00Z", "--site", "139.4,35.5"], "latitude first"),
        (["--at", "2017-08-30T03:00Z", "--site", "Tokyo"], "LAT,LON,ALT"),
        (["--at", "2017-08-30T03:00Z", "--site", "nan,nan"], "LAT,LON,ALT"),
        (["--at", "2017-08-30T03:00Z", "--site", "35,139,inf"], "LAT,LON,ALT"),
        (
            ["--at", "2017-08-30T03:00Z", "--site", "35,139,1e9"],
            "-10000 to 25000",
        ),
        (["--at", "2017-08-30T03:00Z", "--site", "35,139,-1e9"], "elevation in metres"),
        (["--at", "2500-01-01T00:00Z"], "1700..2250"),
        (["--at", "0001-01-01T00:00Z"], "1700..2250"),
    ],
)
def test_what_was_mistyped_is_said(words, told):
    done = run(*PAPER, *words)
    assert done.exit_code == 2
    assert told in done.stderr


def test_a_longitude_counted_to_360_is_the_same_place():
    assert parse_site("37.7,254.08").longitude_deg == pytest.approx(-105.92)
    assert parse_site("37.7,180").longitude_deg == 180.0
