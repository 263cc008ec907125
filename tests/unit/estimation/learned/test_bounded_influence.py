"""One reading or one mark decides nothing: slopes move by a small part of their half-width."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from benchmarks import estimation_influence as influence
from benchmarks.drawn_worlds import BROKEN_CLOUD, CLEAR
from benchmarks.estimation_influence import emptied, marked
from fieldkit.estimation.bins import RegionColumns
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.learned.inputs import doubtful, logged_inputs
from fieldkit.estimation.learned.layout import Layout
from fieldkit.estimation.learned.reading_gaps import WAIT_MIN, reading_at, settled
from fieldkit.estimation.shade_evidence import likely_shaded
from tests.harness.drawn import drawn_world

MINUTES = 40


@pytest.fixture(scope="module", params=[CLEAR, BROKEN_CLOUD])
def world(request):
    drawn = drawn_world(3, request.param, minutes=MINUTES)
    return replace(drawn, settings=replace(drawn.settings, model="learned"))


@pytest.fixture(scope="module")
def undisturbed(world):
    return influence.slopes_of(world)


def moved(world, undisturbed, history):
    """Largest change of a tilt over the larger of its two half-widths."""
    return influence.moved(undisturbed, influence.slopes_of(world, history))


COLUMNS = ("dni_w_m2", "dhi_w_m2", "longwave_down_w_m2", "air_k", "wind_m_s", "temperature_k")


@pytest.mark.parametrize(
    ("column", "row", "most"),
    [
        ("dni_w_m2", 0, 0.35),  # a minute less: what the layers hold is judged by the first that has light
        ("dni_w_m2", 21, 0.25),
        ("air_k", 0, 0.25),
        ("temperature_k", 15, 0.25),
    ],
)
def test_a_minute_without_a_reading_moves_no_slope(world, undisturbed, column, row, most):
    assert moved(world, undisturbed, emptied(world.history, column, row, 2)) <= most


@pytest.mark.parametrize("column", ["dni_w_m2", pytest.param("air_k", marks=pytest.mark.slow)])
def test_an_empty_cell_gives_what_the_rows_without_it_give(world, column):
    without = emptied(world.history, "minute", 21, 0)
    slopes = SlopeChain(world.regions, world.settings).at_once(without).slopes
    assert moved(world, slopes, emptied(world.history, column, 21, 0)) <= 0.1


@pytest.mark.slow
def test_no_minute_and_no_reading_moves_a_slope(world, undisturbed):
    """All of them; what cannot be is emptied before (`test_what_cannot_be_is_as_if_it_were_not_there`)."""
    readings = [
        *product(("minute", *COLUMNS[:-1]), range(MINUTES), (0,)),
        *product(COLUMNS[-1:], range(MINUTES), range(4)),
    ]
    moves = [moved(world, undisturbed, emptied(world.history, *reading)) for reading in readings]
    print(f"99 % {np.quantile(moves, 0.99):.3f}, largest {max(moves):.3f} of {len(moves)}")
    assert np.quantile(moves, 0.99) <= 0.25
    assert max(moves) <= 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("minutes", "moves"),
    [(MINUTES, influence.by_false_mark), (60, influence.by_displaced_mark)],
    ids=["false", "displaced"],
)
@pytest.mark.parametrize("day", [CLEAR, BROKEN_CLOUD])
def test_no_false_or_displaced_mark_moves_a_slope(day, minutes, moves):
    is_displaced = moves is influence.by_displaced_mark
    assert max(moves(drawn_world(3, day, minutes=minutes, shade_test=is_displaced))) <= 0.5


def shaded(history):
    return likely_shaded(history.is_shaded(), history)


def test_a_marked_shade_that_cools_nothing_counts_for_nothing_and_is_named(world):
    layout = Layout.of(RegionColumns(world.regions), np.array([1, 2, 3]), world.settings)
    for region, first, minutes in product(range(4), (0, 9, 20, 33), (3, 5, 20)):
        history = marked(world.history, (region, first, first + minutes))
        # under a cloud a board cools nothing either
        assert not shaded(history)[history.dni_w_m2 > 500.0].any()
        (shade,) = doubtful(history, layout, world.regions)
        assert shade == (world.regions[region].name, history.minute[first])


def test_a_contradicted_mark_moves_no_slope_and_is_in_its_reason(world, undisturbed):
    history = marked(world.history, (2, 20, 25))
    assert moved(world, undisturbed, history) <= 0.25
    reasons = [slope.reason for slope in SlopeChain(world.regions, world.settings).at_once(history).slopes]
    named = [reason.startswith(world.regions[2].name) for reason in reasons]
    assert named == [False, True, False]


@pytest.fixture(scope="module")
def boards():
    """Boards over each bed in turn under a clear sky; region, first and last row of each."""
    drawn = drawn_world(3, CLEAR, minutes=60, shade_test=True)
    return drawn, influence.marks_of(drawn.history)


@pytest.mark.parametrize(
    ("begins", "ends", "aside"),
    [(0, 0, 0), (-8, -8, 0), (-3, -3, 0), (1, 1, 0), (5, 5, 0), (8, 8, 0), (0, 3, 0), (-3, 0, 0), (2, 0, 0),
     (0, -2, 0), (0, 0, 1)],
)  # fmt: skip
def test_shade_is_where_it_cools_however_it_is_marked(boards, begins, ends, aside):
    world, (first, *others) = boards
    region, start, end = first
    displaced = marked(world.history, (region + aside, start + begins, end + ends), *others)
    assert np.array_equal(shaded(displaced), shaded(marked(world.history, first, *others)))
    # all of the board's whole minutes
    assert shaded(displaced)[start + 1 : end - 1, region].all()


def test_shade_across_minutes_without_frames_stays(boards):
    world, marks = boards
    region, start, _ = marks[0]
    history = marked(world.history, *marks).at(np.delete(np.arange(60), [start + 1, start + 2]))
    assert shaded(history)[start + 1, region]


def test_air_without_a_reading_waits_ten_minutes_and_lies_on_a_line(world):
    air = 270.0 + 0.1 * np.arange(MINUTES)
    air[10:14], air[25:] = np.nan, np.nan
    history = replace(world.history, air_k=air)
    assert reading_at(history, "air_k", 12).value == pytest.approx(271.2)
    assert [settled(history.until(rows)) for rows in (13, 15, 26, 36, 37)] == [10, 15, 25, 26, 27]
    held = reading_at(history, "air_k", 39)
    assert (held.value, held.held_min) == (pytest.approx(272.4), 15.0)


def test_a_thermometer_that_is_gone_holds_up_no_minute(world):
    air = np.where(np.arange(MINUTES) < 5, 270.0, np.nan)
    history = replace(world.history, air_k=air)
    assert settled(history) == MINUTES


def test_what_is_missing_in_the_first_minute_alone_counts_as_logged(world):
    about = Layout.of(RegionColumns(world.regions), np.array([1, 2, 3]), world.settings), world.regions
    for column in ("air_k", "dhi_w_m2", "longwave_down_w_m2"):
        history = emptied(world.history, column, 0, 0)
        expected = logged_inputs(world.history, 0, *about, world.settings)
        assert logged_inputs(history, 0, *about, world.settings) == expected


def test_light_without_a_reading_waits_and_lies_on_a_line(world):
    light = np.linspace(800.0, 839.0, MINUTES)
    light[20:23] = np.nan
    history = replace(world.history, dni_w_m2=light)
    assert [settled(history.until(rows)) for rows in (20, 21, 23, 24)] == [20, 20, 20, 24]
    between = reading_at(history, "dni_w_m2", 21)
    assert between.value == pytest.approx(821.0)
    # the light of the log is a straight line: only its usual error is left, a fifth of a reading
    assert 0.0 < between.sd < 0.05 * 839.0


def test_light_that_does_not_come_back_is_held_after_the_wait(world):
    light = np.where(np.arange(MINUTES) < 20, 800.0, np.nan)
    history = replace(world.history, dni_w_m2=light)
    assert settled(history.until(20 + WAIT_MIN)) == 20
    assert settled(history.until(21 + WAIT_MIN)) == 21
    held = reading_at(history, "dni_w_m2", 25)
    assert (held.value, held.held_min) == (800.0, 6.0)
