"""Sweeps: the grid of settings, a region's line in the summary worked out by hand, and the ranking."""

import re
from pathlib import Path

import numpy as np
import pytest

from fieldkit.config import config_from_text
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.region_schedule import RegionSchedule
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.results.minutes import Outcome, Run
from fieldkit.results.session_estimates import Estimates
from fieldkit.results.sources import Source
from fieldkit.results.sweep import SweepTable, rank, read_grid
from tests.harness.next_steps import at


def test_a_range_holds_both_ends_in_decimals_as_one_would_write_them():
    (parameter,) = read_grid(["surface.albedo=0.15:0.35:0.05"]).parameters
    assert parameter.values == ("0.15", "0.20", "0.25", "0.30", "0.35")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.88,0.90 , 0.92", ("0.88", "0.90", "0.92")),
        ("paper,full", ("paper", "full")),
        ("600", ("600",)),
        ("-40:-20:10,0", ("-40", "-30", "-20", "0")),
        ("0:1:0.4", ("0.0", "0.4", "0.8")),
        ("1e-1:0.3:0.1", ("0.1", "0.2", "0.3")),
        ('["cloud", "cable"]', ('["cloud", "cable"]',)),
        ("0.2,0.2", ("0.2",)),
    ],
)
def test_lists_ranges_and_single_values(text, values):
    assert read_grid([f"a.b={text}"]).parameters[0].values == values


def test_sets_are_all_combinations_the_last_parameter_fastest():
    grid = read_grid(["a.x=1,2", "a.y=5", "a.z=p,q"])
    assert grid.sets == [
        ("a.x=1", "a.y=5", "a.z=p"), ("a.x=1", "a.y=5", "a.z=q"),
        ("a.x=2", "a.y=5", "a.z=p"), ("a.x=2", "a.y=5", "a.z=q"),
    ]  # fmt: skip
    assert [parameter.key for parameter in grid.varied_parameters] == ["a.x", "a.z"]


@pytest.mark.parametrize("text", ["0.3:0.1:0.1", "0:1:0", "0:1:-0.1", "0:1:0.000001"])
def test_a_range_that_goes_nowhere_is_refused(text):
    with pytest.raises(ConfigError, match="STEP"):
        read_grid([f"surface.albedo={text}"])


@pytest.mark.parametrize("setting", ["surface.albedo", "surface.albedo=", "=0.2"])
def test_a_setting_without_key_or_value_is_refused(setting):
    with pytest.raises(ConfigError, match="no value"):
        read_grid([setting])


def test_a_key_given_twice_is_refused():
    with pytest.raises(ConfigError, check=at("a.b")):
        read_grid(["a.b=1", "a.b=2"])


GRID = read_grid(["a=1,2,3"])


def ranking_of(error, answers=None, worst=None, grid=GRID, wide=None):
    error = np.array(error, float)
    answers = np.full(error.shape, 10) if answers is None else np.array(answers)
    wide = np.zeros(error.shape, np.int64) if wide is None else np.array(wide)
    worst = error * 2 if worst is None else worst
    names = [f"day-{place + 1}" for place in range(error.shape[1])]
    return rank(error, worst, answers, wide, grid, names)


def test_the_best_set_has_the_smallest_mean_error_over_sessions():
    found = ranking_of([[3, 3], [1, 2], [2, 2]])
    assert found.best == 1
    assert found.error_deg.tolist() == [3, 1.5, 2]
    assert found.worst_deg == 4


def test_leaving_a_session_out_shows_what_a_lucky_choice_is_worth():
    # by hand: without the first session set 2 wins (1 < 2) and gives the first 9;
    # without the second, set 0 wins (0 < 2) and gives the second 9: 9 on average, not 2
    found = ranking_of([[0, 9], [2, 2], [9, 1]])
    assert (found.best, found.error_deg[found.best]) == (1, 2)
    assert (found.cross_validated_deg, found.same_choice, found.folds) == (9, 0, 2)
    assert any("overfitting" in warning for warning in found.warnings)


def test_a_choice_that_every_session_agrees_with_is_not_doubted():
    found = ranking_of([[3, 3, 3], [1, 1.1, 1], [2, 2, 2]])
    assert (found.same_choice, found.folds) == (3, 3)
    assert found.cross_validated_deg == pytest.approx(found.error_deg[1])
    assert found.warnings == ()


def test_one_session_cannot_tell():
    found = ranking_of([[3], [1], [2]])
    assert np.isnan(found.cross_validated_deg)
    assert "one session" in found.warnings[0]


def test_a_set_that_hardly_answers_is_not_ranked():
    found = ranking_of([[0.1, 0.1], [1, 1], [2, 2]], answers=[[2, 2], [10, 10], [10, 10]])
    assert found.best == 1
    assert np.isnan(found.error_deg[0])


def test_a_session_without_any_estimate_counts_for_nothing_and_is_named():
    found = ranking_of([[3, np.nan, 3], [1, np.nan, 1], [2, np.nan, 2]])
    assert (found.best, found.folds, found.unranked) == (1, 2, ("day-2",))
    (warning,) = found.warnings
    assert warning.endswith(": day-2")


def test_another_choice_that_is_as_good_is_not_called_overfitting():
    # by hand: without the first session set 1 wins and gives it 0.74 (set 0: 0.70); without the second, set 0
    # wins and gives it 0.70: 0.72 on average, the best set's 0.70 and 0.70
    found = ranking_of([[0.70, 0.70], [0.74, 0.69]], grid=read_grid(["a=1,2"]))
    assert (found.same_choice, found.folds) == (1, 2)
    assert found.cross_validated_deg == pytest.approx(0.72)
    (warning,) = found.warnings
    assert "overfitting" not in warning
    assert re.search(r"0\.72°.* 0\.70°", warning)


def test_parameters_that_solve_no_other_session_are_not_cross_validated():
    found = ranking_of([[3, np.nan], [np.nan, 1]], grid=read_grid(["a=1,2"]))
    assert np.isnan(found.cross_validated_deg)
    (warning,) = found.warnings
    assert "cross-validated" in warning


def test_nothing_known_gives_no_ranking():
    assert ranking_of(np.full((3, 2), np.nan)) is None


def test_a_ranking_says_how_many_of_its_slopes_are_wide():
    found = ranking_of([[3, 3], [1, 1], [2, 2]], wide=[[0, 0], [10, 5], [0, 0]])
    assert found.wide_share == 0.75
    assert found.warnings[0].startswith("75% of the best set's slopes are wide")


def test_the_effect_of_a_parameter_is_its_mean_over_the_others():
    grid = read_grid(["a=1,2", "b=x,y"])
    found = ranking_of([[1], [3], [5], [7]], grid=grid)  # a: (1+3)/2, (5+7)/2; b: (1+5)/2, (3+7)/2
    assert [(effect.key, effect.error_deg) for effect in found.effects] == [("a", (2, 6)), ("b", (3, 5))]
    assert [effect.span_deg for effect in found.effects] == [4, 2]


def test_a_best_value_at_the_end_of_those_tried_is_told():
    found = ranking_of([[1, 1], [2, 2], [3, 3]])
    (warning,) = found.warnings
    assert warning.startswith("a: ")


# --- one bed's line in the summary

BED = Region("b15", RegionKind.TARGET, ((0.0, 0.0),), 15.0, 180.0)


def line(region: Region, *found: tuple[SlopeState, float]) -> dict[str, float]:
    rows = enumerate(found)
    estimates = [SlopeEstimate(n * 60 * 10**9, region.name, state, tilt) for n, (state, tilt) in rows]
    rows = Estimates.of(estimates, {"temperature_k": 300.0, "irradiance_w_m2": 800.0}, (region,))
    path = Path("day.h5")
    table = SweepTable(read_grid([]), {path: "day"})
    config = config_from_text("[site]\nlatitude_deg = 0\nlongitude_deg = 0\n", Path("fieldkit.toml"))
    source = Source(path, "", "", config, RegionSchedule.of((region,)))
    run = Run(source, config.site, EstimatorSettings())
    table.add(Outcome(run, rows))
    return {name: values[0] for name, values in table.columns().items()}


def test_errors_are_of_the_minutes_with_an_answer():
    ok = SlopeState.OK
    held, few = (SlopeState.HELD_CLOUD, 40.0), (SlopeState.TOO_FEW, np.nan)
    found = line(BED, (ok, 16.0), (ok, 13.0), (ok, 15.5), held, few)
    assert (found["minutes"], found["answered"]) == (5, 3)
    assert found["median_tilt_deg"] == 15.5
    assert found["mean_error_deg"] == pytest.approx((1.0 - 2.0 + 0.5) / 3)
    assert found["mean_abs_error_deg"] == pytest.approx(3.5 / 3)
    assert found["median_abs_error_deg"] == 1.0
    assert found["worst_abs_error_deg"] == 2.0


def test_a_region_row_of_unknown_slope_has_no_error():
    found = line(Region("x", RegionKind.TARGET, ((0.0, 0.0),)), (SlopeState.OK, 16.0))
    assert found["median_tilt_deg"] == 16.0
    assert np.isnan([found[name] for name in found if name.endswith("error_deg")]).all()
