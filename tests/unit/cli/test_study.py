import csv
import json
import re

import pytest
from click.testing import CliRunner

from fieldkit.cli.study import command
from fieldkit.model.errors import NoAnswerError

FEW = ["--slopes", "400"]


def run(out, *words: str):
    return CliRunner().invoke(command, ["--out", str(out), *words], catch_exceptions=False)


@pytest.fixture(scope="module")
def paper_study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    return folder, json.loads(run(folder, *FEW, "--json").stdout)


def test_table_2_agrees_with_print_but_for_one_cell(paper_study):
    _, document = paper_study
    hours = ("12h", "13h", "14h", "15h")
    cells = [(row[hour], row[f"{hour}_paper"]) for row in document["table_2"] for hour in hours]
    assert len(cells) == 28
    different = [found for found, printed in cells if round(found, 1) != printed]
    assert different == pytest.approx([49.55], abs=0.003)


def test_least_squares_is_exact_and_the_papers_grid_is_not(paper_study):
    _, document = paper_study
    rows = {(row["start"], row["estimator"]): row for row in document["errors"]}
    # section 4: 90 % of the observations are below 0.43, 0.62 and 0.9 degrees
    for start, printed in (("09:00", 0.43), ("12:00", 0.62), ("15:00", 0.9)):
        assert rows[start, "unit-norm"]["tilt_p90"] <= 0.01
        assert 0.1 < rows[start, "contours"]["tilt_p90"] < 1.0
        assert rows[start, "contours"]["paper_tilt_p90"] == printed


def test_field_days_meet_errors_like_the_papers(paper_study):
    # section 5: RMSE 1.83 degrees Celsius, errors around 2 to 7 degrees
    _, document = paper_study
    assert [day["day"] for day in document["field"]] == ["2017-08-30", "2017-12-11"]
    for day in document["field"]:
        assert 0.5 < day["rmse_k"] < 3.7
        assert 1.0 < day["mean_tilt_error_deg"] < 7.0


def test_every_figure_and_table_is_written_and_the_page_asks_for_nothing(paper_study):
    folder, _ = paper_study
    figures = {path.name[:9] for path in folder.glob("figure-*.svg")}
    assert figures == {f"figure-{number:02d}" for number in (5, 6, 7, 8, 9, 10, 12, 13, 14)}
    for name in ("table-2", "errors", "directions", "field-errors"):
        with (folder / f"{name}.csv").open() as file:
            assert len(list(csv.DictReader(file))) >= 6
    page = (folder / "study.html").read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)\s*=\s*"(?!data:|#)', page)


def test_other_places_days_and_noise(recorded, tmp_path):
    words = ["--site", "-33.9,151.2,60", "--on", "2026-01-15", "--start", "10:00", "--noise", "0.1"]
    short = ["--dni", "900", "--session", str(recorded(tmp_path / "c"))]  # a field day of twelve minutes
    document = json.loads(run(tmp_path, *FEW, *words, *short, "--json").stdout)
    assert document["irradiance"] == "constant 900 W/m²"
    assert document["site"]["timezone"] == "Etc/GMT-10"
    assert {row["start"] for row in document["errors"]} == {"10:00"}
    assert all(0.3 < row["tilt_mae"] < 6.0 for row in document["errors"])
    (day,) = document["field"]  # beds of 5, 15 and 25 degrees, whose truth is in the session
    assert day["rmse_k"] < 3.0
    assert day["mean_tilt_error_deg"] < 4.0
    assert (tmp_path / "figure-13.svg").exists()


def test_sensitivity_shows_the_tolerance(recorded, tmp_path):
    short = ["--session", str(recorded(tmp_path / "c"))]
    words = ["--sensitivity", "--start", "12:00", "--estimator", "contours", "--json", *short]
    rows = json.loads(run(tmp_path, *FEW, *words).stdout)["sensitivity"]
    assert len({(row["irradiance"], row["tolerance_w_m2"]) for row in rows}) == 20
    bright = [row["p90_12:00"] for row in rows if "800" in row["irradiance"]]
    assert max(bright) > 1.5 * min(bright)


def test_night_has_no_study(tmp_path):
    with pytest.raises(NoAnswerError, match="sunlight"):
        run(tmp_path, *FEW, "--start", "22:00")
