"""What a notebook calls: estimates, maps, reports and plans without a command line."""

import csv
import re
import shutil
from dataclasses import replace
from datetime import date, datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import fieldkit
from fieldkit.model.clock import utc_ns
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Quality
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.model.units import SECOND_NS
from fieldkit.recording.plan import PlanOptions, plan
from fieldkit.results import minutes as minutes_service
from fieldkit.results.batch import estimate_sessions
from fieldkit.results.describe import describe
from fieldkit.results.estimate import estimate
from fieldkit.results.report import report
from fieldkit.results.session import open_session
from fieldkit.results.session_estimates import Estimates, LearntSeries
from fieldkit.results.slope_map import slope_map
from fieldkit.results.sources import settings_from
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.time_map import TimeStep
from tests.harness.learnt import learnt
from tests.harness.next_steps import at


def test_an_estimate_keeps_all_32_flags_as_a_file_may_state_them():
    every, bed = Quality(2**32 - 1), Region("bed", RegionKind.TARGET, ((0.0, 0.0),))
    measured = {"temperature_k": np.nan, "irradiance_w_m2": np.nan}
    found = SlopeEstimate(0, "bed", SlopeState.NO_DATA, flags=every)
    estimates = Estimates.of([found], measured, (bed,))
    assert estimates["bed"].flags == every


def test_estimates_are_found_by_region_and_changed_by_parameters(sessions):
    with open_session(sessions[0]) as session:
        configured = estimate(session)
    brighter = estimate(sessions[0], {"surface.albedo": 0.4})
    assert list(configured.final) == ["b05", "b15", "b25"]
    assert configured["b15"].region == "b15"
    assert configured["b15"].tilt_deg != brighter["b15"].tilt_deg
    assert brighter["b15"].tilt_deg == estimate(sessions[0], albedo=0.4)["b15"].tilt_deg
    assert estimate(sessions[0], model="full")["b15"].model.startswith("full")


def test_a_parameter_that_does_not_exist_is_named(sessions):
    for name, meant in (("colour", "configuration reference"), ("albdo", "albedo")):
        with pytest.raises(ConfigError, match=meant, check=at(name)):
            estimate(sessions[0], {name: 1.0})


@pytest.mark.parametrize(
    ("key", "value"), [("tilt_deg", 150.0), ("emissivity", 90.0), ("azimuth_deg", -500.0)]
)
def test_a_region_that_is_drawn_afterwards_has_the_limits_of_the_configuration(sessions, key, value):
    with fieldkit.open_session(sessions[0]) as session:
        drawn = [replace(session.regions[0], **{key: value}), *session.regions[1:]]
        with pytest.raises(ConfigError, check=at(f"regions: region[0].{key}")):
            session.estimate(regions=drawn)
        assert session.estimate(model="full", regions=session.regions).final


def test_several_sessions_are_estimated_together_and_a_torn_one_does_not_stop_them(sessions, tmp_path):
    torn = tmp_path / "torn.h5"
    torn.write_bytes(sessions[0].read_bytes()[:1000])
    steps = []
    found = estimate_sessions([*sessions, torn], on_progress=lambda *step: steps.append(step))
    assert list(found.estimates) == [path.stem for path in sessions]
    assert list(found.failures) == [torn]
    assert steps == [(1, 2), (2, 2)]
    alone = estimate(sessions[1])
    together = found.estimates[sessions[1].stem]
    assert np.array_equal(alone.rows["tilt_deg"], together.rows["tilt_deg"], equal_nan=True)


def test_a_slope_map_has_its_arrays_by_pixel(sessions):
    found = slope_map(sessions[0], "all")
    arrays = found.to_xarray()
    assert isinstance(arrays, xr.Dataset)
    assert arrays["tilt_deg"].dims == ("y", "x")
    assert arrays["tilt_deg"].attrs["units"] == "degree"
    assert {one.region for one in found.by_region()} >= {"b05", "b15", "b25"}
    assert slope_map(sessions[0], "4m").minutes < found.minutes
    with pytest.raises(ConfigError, check=at(Argument("window"), Argument("window", "20m"))):
        slope_map(sessions[0], 20)


def test_numbers_of_numpy_paths_and_tables_are_values_of_settings():
    values = {
        "albedo": np.float32(0.25),
        "estimator.min_minutes": np.int64(7),
        "refraction": np.bool_(True),
        "site.horizon": np.array([[0, 5], [90, 7]]),
        "camera.pose": Path("poses/a.toml"),
        "measures": {"sun": "ghi"},
    }
    assert settings_from("surface.albedo=0.4") == ["surface.albedo=0.4"]
    assert settings_from(values) == [
        "surface.albedo=0.25",
        "estimator.min_minutes=7",
        "estimator.refraction=true",
        "site.horizon=[[0, 5], [90, 7]]",
        'camera.pose="poses/a.toml"',
        'irradiance.measures={sun = "ghi"}',
    ]


@pytest.mark.parametrize("value", [None, {1, 2}, b"x", object()])
def test_a_value_that_no_setting_can_have_is_named_with_its_key(value):
    with pytest.raises(ConfigError, match="albedo: TOML"):
        settings_from({"albedo": value})


def test_a_session_and_its_file_give_the_same(sessions, tmp_path):
    with fieldkit.open_session(sessions[0]) as session:
        opened = fieldkit.export(session, "csv", tmp_path / "opened"), fieldkit.check(session)
        assert session.export("csv", tmp_path / "method").files
        assert session.state == "sealed"
        assert session.count("camera") > 0  # still open
    named = fieldkit.export(sessions[0], "csv", tmp_path / "named"), fieldkit.check(sessions[0])
    assert [path.name for path in opened[0].files] == [path.name for path in named[0].files]
    assert opened[1] == named[1]


def test_a_report_of_several_leaves_out_what_cannot_be_read(sessions, tmp_path):
    both = report([*sessions, tmp_path / "none.h5"], tmp_path / "all.html")
    assert list(both.failures) == [tmp_path / "none.h5"]


def test_a_plan_is_a_table_of_times_and_facets():
    site = Site(35.558675, 139.395232, 9.0, "Asia/Tokyo")
    made = plan(site, date(2026, 12, 11), [(5.0, 180.0), (15.0, 180.0)], PlanOptions(step_min=60))
    frame = made.to_frame()
    assert set(frame["tilt_deg"]) == {5.0, 15.0}
    assert len(frame) == 2 * len(made.rows)
    assert (frame["kelvin_per_degree"].between(0.0, 1.0)).all()


def test_what_the_data_taught_comes_with_the_slopes_and_from_the_cache(
    sessions, monkeypatch, tmp_path, cache_folder
):
    """Each minute's synthetic one, through workers, cache, tables and files."""
    genuine = minutes_service.solve

    def with_learnt(history, regions, settings):
        found = {int(time_ns): learnt(minute) for minute, time_ns in enumerate(history.time_ns)}
        return replace(genuine(history, regions, settings), learnt=LearntSeries(found))

    # the learned model takes a day of minutes to learn all of this
    monkeypatch.setattr(minutes_service, "solve", with_learnt)
    for _ in ("made", "cached"):
        slopes = estimate(sessions[0], albedo=0.31)
        minutes = slopes.learnt.by_time_ns
        assert list(minutes) == sorted(set(slopes.rows["time_ns"].tolist()))
        assert list(minutes.values()) == [learnt(minute) for minute in range(len(minutes))]
        assert slopes.learnt["depth"] == learnt(len(minutes) - 1).parameters[3]
    table = slopes.learnt.to_frame()
    assert table["parameter"].tolist()[:2] == ["gain", "exchange"]
    assert len(table) == 9 * len(minutes)
    assert table["share_of_prior"].iloc[0] == 1.0
    assert slopes.learnt.residuals()["residual_k"].tolist()[:3] == [0.05, 0.06, 0.071]
    assert "thermal inertia" in slopes.learnt._repr_html_()
    with pytest.raises(KeyError, match="no parameter 'colour'"):
        slopes.learnt["colour"]
    written = estimate_sessions(sessions, ["surface.albedo=0.31"]).write(tmp_path / "base")
    with (tmp_path / "base-learnt.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tmp_path / "base-learnt.csv" in written
    assert rows[3]["session"] == sessions[0].stem
    assert (rows[3]["parameter"], rows[3]["unit"], rows[3]["prior"]) == ("depth", "cm", "3.0")


def test_other_models_learn_nothing_and_write_no_table_of_it(sessions, tmp_path):
    found = estimate_sessions([sessions[0]], ["estimator.model=full"])
    assert found.estimates[sessions[0].stem].learnt.final is None
    assert [path.suffixes for path in found.write(tmp_path / "base")][-1] == [".json"]
    assert not list(tmp_path.glob("base-learnt*"))


EARLIER_NS = 7_200_000_000_000


def times_ns(session):
    """The times of all that is computed from a session or drawn of it."""
    estimates, axes = session.estimate(model="full"), session.plot()
    mapped = session.slope_map("all", settings={"estimator.model": "full"})
    shown = describe(session)
    return {
        "estimate": estimates.rows["time_ns"].tolist(),
        "windows": estimates.rows["window_start_ns"].tolist(),
        "to_frame": estimates.to_frame().index.as_unit("ns").asi8.tolist(),
        "slope_map": [mapped.start_ns, mapped.end_ns],
        "plot": [round(day * 86_400) * SECOND_NS for day in axes.lines[0].get_xdata()],
        "show": [utc_ns(datetime.fromisoformat(shown[name])) for name in ("start", "end")],
    }


def test_results_and_figures_have_the_times_of_a_corrected_clock(sessions, tmp_path):
    """A clock two hours ahead; the recording began at 12:00:01 by it, and ended at 12:11."""
    path = tmp_path / shutil.copy(sessions[0], tmp_path)
    with fieldkit.open_session(path) as session:
        recorded_ns = times_ns(session)
    apply_time_map(path, [TimeStep(0, -EARLIER_NS, "another clock")])
    with fieldkit.open_session(path) as session:
        corrected_ns = times_ns(session)
        made = session.report(tmp_path / "report.html")
        assert session.count("camera") > 0  # still open
    assert (made.sessions, made.path) == ((path,), tmp_path / "report.html")
    page = made.path.read_text(encoding="utf-8")
    assert page.lower().startswith("<!doctype html>")
    for name, times in recorded_ns.items():
        assert corrected_ns[name] == [time_ns - EARLIER_NS for time_ns in times], name
    assert re.search(r"\b10:0\d", page)
    assert re.findall(r".*\b12:[01]\d.*", page) == []
