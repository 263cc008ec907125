import json
import math
import re
import subprocess
import sys
from dataclasses import replace
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import pandas
import pytest
from click.testing import CliRunner
from pvlib import solarposition

from fieldkit.cli import main
from fieldkit.cli.plan import command
from fieldkit.model.errors import ConfigError, NoAnswerError
from fieldkit.model.site import Site
from fieldkit.recording import plan as planning
from fieldkit.recording.planned_session import Expected, Prediction
from fieldkit.views import plotting

PAPER = ["--site", "35.558675,139.395232,9"]
WINTER = ["--on", "2026-12-11", "--facet", "5,180", "--facet", "15,180", "--facet", "25,180"]
AUGUST = ["--on", "2017-08-30", "--facet", "10,180", "--facet", "20,180"]


@pytest.fixture(autouse=True)
def one_prediction(monkeypatch):
    """The day's table in no time: predictions are run in tests/unit/recording/test_planned_session.py."""

    def two(session):
        facets = len(session.facets)
        planned = Expected("as planned", session.minutes, (1.96, *(4.0,) * (facets - 1)))
        return Prediction(session, (planned, Expected("with air", session.minutes, (0.97,) * facets)))

    monkeypatch.setattr(planning, "predict_session", two)


def run(*words: str):
    return CliRunner().invoke(command, [*PAPER, *words], catch_exceptions=False)


def document(*words: str) -> dict:
    """The plan; a --site in its words replaces the paper's."""
    return json.loads(run(*words, "--json").stdout)


def at(plan: dict, hour: str) -> dict:
    return next(row for row in plan["rows"] if f"T{hour}" in row["time"])


def test_winter_day_of_sand_slopes():
    # S 800 W/m2: W/m2 per degree of 5, 15 and 25 degrees towards the south, K per degree by eq. (6) at 295 K
    plan = document(*WINTER)
    for hour, light, kelvin in [
        ("10:00", (10.7, 9.2, 7.5), (0.36, 0.32, 0.26)),
        ("12:00", (11.2, 9.6, 7.7), (0.38, 0.33, 0.26)),
        ("15:00", (8.8, 7.9, 6.8), (0.30, 0.27, 0.23)),
    ]:
        beds = at(plan, hour)["facets"]
        assert [bed["w_m2_per_degree"] for bed in beds] == pytest.approx(light, abs=0.06)
        # the plan expects warmer sand than 295 K, which makes a kelvin worth 2 % more light
        assert [bed["kelvin_per_degree"] for bed in beds] == pytest.approx(kelvin, rel=0.04)
    assert at(plan, "11:30")["verdict"] == "usable"
    assert at(plan, "08:00")["verdict"].startswith("fair")
    assert at(plan, "15:30")["verdict"].startswith("fair")
    assert at(plan, "16:00")["verdict"].startswith("poor")


def test_cold_air_sharpens():
    noon = {air: at(document(*WINTER, "--air-c", air), "12:00")["facets"][1] for air in ("-10", "30")}
    # longwave and exchange grow with temperature: colder ground shows a watt in more kelvin
    assert noon["-10"]["kelvin_per_degree"] > 1.05 * noon["30"]["kelvin_per_degree"]
    assert document(*WINTER, "--noise", "0.5")["noise_k"] == 0.5


def test_sun_of_the_winter_day_in_one_line():
    # sunrise and sunset with refraction and half the sun's width, as almanacs count them
    line = run(*WINTER).stdout.splitlines()[0]
    assert re.search(r"06:42–16:29, noon 11:35, .*31\.5°", line)
    assert "UTC+09:00" in line


@pytest.mark.parametrize(
    ("place", "zone", "day", "told"),
    [
        # Tokyo on clocks of Greenwich: the same sunrise and sunset, nine hours less
        ("35.558675,139.395232,9", "UTC", "2026-12-11", "21:42–07:29, noon 02:35"),
        # in Fairbanks the sun of midsummer sets after midnight; it is up for all but two hours
        ("64.8378,-147.7164", "America/Anchorage", "2026-06-21", "02:58–00:47, noon 13:53"),
        ("78.2,15.6", "Arctic/Longyearbyen", "2026-06-21", "all day, noon 12:59"),
    ],
)
def test_a_day_is_not_cut_where_clocks_show_midnight_in_sunlight(place, zone, day, told):
    words = ["--site", place, "--zone", zone, "--on", day, "--facet", "10,180"]
    printed = run(*words).stdout
    lines = printed.splitlines()
    assert told in lines[0]
    assert "°" in lines[1]
    if "Anchorage" in zone:  # a row of the next day has its date
        assert re.findall(r"^(2026-\S+ \S+)", printed, re.M) == ["2026-06-22 00:00"]


def test_august_says_the_steep_bed_is_weak_after_two_and_names_the_twins():
    plan = document(*AUGUST)
    # mirror image of 20 degrees south in the plane of the sun's motion about noon: 33 degrees, 180
    assert any("33°/180°" in line for line in plan["warnings"])
    assert any("20°/180°" in line and "after 14:00" in line for line in plan["warnings"])
    assert "weak for 20°/180°" in at(plan, "14:30")["verdict"]
    assert at(plan, "11:30")["verdict"] == "usable"


def test_a_campaign_is_planned_with_its_azimuths_references_and_instruments(tmp_path, monkeypatch):
    sessions, predict = [], planning.predict_session
    # the sessions that would be predicted, which nothing prints
    monkeypatch.setattr(
        planning, "predict_session", lambda session: sessions.append(session) or predict(session)
    )
    corners = "points_px = [[0, 0], [9, 0], [9, 9]]\n"
    beds = "".join(
        f'[[region]]\nname = "b{tilt}"\nkind = "{kind}"\ntilt_deg = {tilt}\nazimuth_deg = 180\n{corners}'
        for tilt, kind in ((2, "reference"), (10, "target"), (20, "target"))
    )
    site = "[site]\nlatitude_deg = 35.558675\nlongitude_deg = 139.395232\nelevation_m = 9\n"
    site += 'timezone = "Asia/Tokyo"\n[estimator]\nazimuth = "known"\nnoise_k = 0.03\n'
    meters = '[thermometer]\ndriver = "center-309"\noptions = {labels = ["T1", "T2", "T3", "air"]}\n'
    meters += '[irradiance]\nmeasures = {sky = "longwave_down"}\n'
    (tmp_path / "fieldkit.toml").write_text(f'{site}{meters}{beds}[[region]]\nname = "bare"\n{corners}')
    words = ["plan", "-C", str(tmp_path), "--on", "2017-08-30", "--at", "10:30", "--for", "2h", "--json"]
    done = CliRunner().invoke(main, words, catch_exceptions=False)
    assert "bare" in done.stderr
    found = json.loads(done.stdout)
    words[3:3] = ["--site", "10,20"]
    CliRunner().invoke(main, words, catch_exceptions=False)
    session, elsewhere = sessions
    assert elsewhere == replace(session, site=elsewhere.site, start_ns=elsewhere.start_ns)
    assert (elsewhere.site.latitude_deg, elsewhere.site.timezone) == (10.0, "Etc/GMT-1")
    assert session.references == ((2.0, 180.0),)
    assert session.facets == ((10.0, 180.0), (20.0, 180.0))
    assert session.logged == {"air", "longwave"}
    assert (session.settings.azimuth, session.settings.noise_k) == ("known", 0.03)
    assert found["session"]["start"] == "2017-08-30T10:30:00+09:00"
    assert found["noise_k"] == 0.03


def test_the_next_day_is_planned_without_one(monkeypatch):
    zone = ZoneInfo("Asia/Tokyo")
    tomorrow = datetime.now(zone).date() + timedelta(days=1)
    found = document("--facet", "10,180", "--zone", "Asia/Tokyo")
    assert str(tomorrow) in (found["day"], str(datetime.now(zone).date()))


def test_the_chart_marks_weakness_on_both_sides_of_zero(tmp_path, monkeypatch):
    # a steep bed in August: a steeper facet turns away from the sun, so a degree is worth less than nothing
    drawn, svg = [], plotting.svg
    # a band is measured on the axes, not in the drawn file
    monkeypatch.setattr(plotting, "svg", lambda figure: drawn.append(figure) or svg(figure))
    run(*AUGUST, "--facet", "35,180", "--out", str(tmp_path / "plan.html"))
    (band,) = drawn[0].axes[0].patches
    assert (band.get_y(), band.get_y() + band.get_height()) == pytest.approx((-1 / 30, 1 / 30))


def test_steep_beds_are_allowed_less_bias():
    budget = [bed["kelvin"] for bed in document(*WINTER)["bias_budget"]]
    assert budget == sorted(budget, reverse=True)
    # 2 degrees at 15 degrees: 0.6 K between beds
    assert budget[1] == pytest.approx(0.6, abs=0.06)


def test_clear_sky_model_replaces_the_constant():
    constant, modelled = document(*AUGUST), document(*AUGUST, "--clear-sky", "3")
    assert at(constant, "12:00")["direct_normal_w_m2"] == 800.0
    assert at(modelled, "17:00")["direct_normal_w_m2"] < 0.8 * at(modelled, "12:00")["direct_normal_w_m2"]


def test_page_is_one_file_that_asks_for_nothing(tmp_path):
    out = tmp_path / "plans" / "plan.html"
    run(*AUGUST, "--out", str(out))
    page = out.read_text(encoding="utf-8")
    assert '<svg role="img"' in page
    assert not re.findall(r'(?:src|href)\s*=\s*"(?!data:|#)', page)
    assert "after 14:00" in page


WITHOUT_MATPLOTLIB = """
import sys
sys.modules["matplotlib"] = None
from fieldkit.cli.plan import command
from fieldkit.views import plotting
command(sys.argv[1:])
"""


def test_page_without_matplotlib_says_what_to_install(tmp_path):
    out = tmp_path / "plan.html"
    words = [*PAPER, *AUGUST, "--for", "20m", "--out", str(out)]
    subprocess.run([sys.executable, "-c", WITHOUT_MATPLOTLIB, *words], check=True, timeout=500)
    page = out.read_text(encoding="utf-8")
    assert "fieldkit-slope[lab]" in page
    assert "<table>" in page


def test_an_unknown_time_zone_is_refused():
    with pytest.raises(ConfigError, match="Jezero"):
        run(*AUGUST, "--zone", "Mars/Jezero")


def test_polar_night_has_no_plan():
    with pytest.raises(NoAnswerError, match="rise"):
        run("--site", "78.2,15.6", "--on", "2026-12-21", "--facet", "10,180")


@pytest.mark.parametrize(
    "option", ["--for=2m", "--step=0", "--step=3m30s", "--dni=-1", "--dni=8000", "--on=2500-01-01"]
)
def test_impossible_numbers_are_refused(option):
    done = run(*AUGUST, option)
    assert done.exit_code == 2
    assert option.partition("=")[0] in done.stderr


def test_the_suns_azimuth_over_the_day_is_nrels():
    shown = dict(re.findall(r"^(\d\d:\d\d) +\S+ +(\d+)°", run(*AUGUST, "--zone", "Asia/Tokyo").stdout, re.M))
    assert len(shown) > 20
    times = pandas.DatetimeIndex([f"2017-08-30T{at}" for at in shown], tz="Asia/Tokyo")
    expected = solarposition.get_solarposition(times, 35.558675, 139.395232, altitude=9.0)["azimuth"]
    assert [int(one) for one in shown.values()] == pytest.approx(expected.to_numpy(), abs=0.6)


def test_the_session_leads(tmp_path):
    page = tmp_path / "plan.html"
    lines = run(*AUGUST, "--for", "45m", "--out", str(page)).stdout.splitlines()
    assert lines[1].startswith("after 45 min (")
    # 20 degrees within 4 is wider than 0.15 of it, 10 within 1.96 not wider than 2 degrees
    assert lines[1].endswith("tilt ≈2.0°  ≈4.0° (90 %): wide for 20°/180°")
    assert lines[2].endswith("with air: −51 %  −76 %")
    assert "≈4.0°" in page.read_text(encoding="utf-8")
    found = document(*AUGUST)
    assert found["verdict"] == "wide for 20°/180°"
    assert [row["half_region_deg"] for row in found["prediction"]] == [[1.96, 4.0], [0.97, 0.97]]
    assert (found["session"]["minutes"], found["session"]["logged"]) == (180, [])


def test_a_day_without_a_usable_window_has_no_session():
    # the sun reaches 3 degrees at noon: below the plan's limit of 8
    found = document("--site", "63.4,10.4", "--on", "2026-12-21", "--facet", "15,180")
    assert found["prediction"] is None
    assert any("measured" in line for line in found["warnings"])


def test_a_slope_that_the_sun_never_reaches_hides_no_window():
    # at noon of midwinter the sun stands at 21 degrees: behind a slope of 30 degrees to the north all day
    words = ("--site", "45,10,100", "--on", "2026-12-21", "--facet", "15,180")
    alone, beside = document(*words), document(*words, "--facet", "30,0")
    assert beside["best_time"] == alone["best_time"]
    assert len(beside["prediction"]) == 2
    assert any("30°/0°" in line and "all day" in line for line in beside["warnings"])


def test_the_best_window_has_the_sun_on_as_many_slopes_as_possible():
    # 60 degrees to the east and to the west: both are lit around noon alone
    words = ("--site", "37.7,-105.9,2317", "--on", "2026-06-21", "--facet", "60,90", "--facet", "60,270")
    assert document(*words)["best_time"][11:13] in ("11", "12")


def test_a_remedy_for_a_twin_excludes_the_twin_alone():
    # at 34 degrees south the sun of late November passes 12 degrees north of the zenith
    facets = ("--facet", "5,0", "--facet", "15,0", "--facet", "25,0", "--facet", "5,90")
    words = ("--site", "-33.9,18.4,10", "--on", "2026-11-28", *facets)
    twins = [line for line in document(*words)["warnings"] if "twin" in line]
    remedies = [line.split("; ")[1] for line in twins]
    assert all("hours" in remedy for remedy in remedies)
    limits = [(re.findall(r"\d+°", remedy), "azimuth" in remedy) for remedy in remedies]
    assert limits == [(["20°"], False), ([], False), ([], True), (["26°"], True)]


def test_a_slope_beyond_the_limit_is_named():
    lines = document(*WINTER, "--facet", "60,180")["warnings"]
    assert any(line.startswith("60°/180°") and "estimator.tilt_limit_deg = 45" in line for line in lines)


def test_a_sun_that_is_up_between_two_rows_alone_has_a_row():
    (row,) = document(*WINTER, "--step", "24h")["rows"]
    assert row["time"] == "2026-12-11T11:35:00+09:00"


@pytest.mark.parametrize(
    ("body", "longitude_deg", "day"), [("mars", 137.4, "2026-06-21"), ("moon", 0.0, "2150-01-10")]
)
def test_other_worlds_are_planned_without_warnings_of_libraries(body, longitude_deg, day):
    # dust at the horizon leaves less light than a quotient can hold; the ephemeris ends in 2100
    site = Site(4.5, longitude_deg, -4500.0, body=body)
    assert planning.plan(site, day, [(15.0, 180.0)]).rows


@pytest.mark.parametrize("facets", [[], [(15.0, math.nan)], [(95.0, 180.0)]])
def test_a_plan_needs_facets_that_can_be(facets):
    with pytest.raises(ConfigError, match="360°"):
        planning.plan((35.56, 139.40), "2026-12-11", facets)


@pytest.mark.parametrize(
    "wrong", [{"dni_w_m2": math.nan}, {"turbidity": 0.0}, {"air_c": math.inf}, {"step_min": -30}]
)
def test_assumptions_of_a_plan_are_possible_numbers(wrong):
    with pytest.raises(ConfigError, match=f"{next(iter(wrong))}: "):
        planning.PlanOptions(**wrong)
