"""Shade tests: beds of the packaged day's simulated sand, a board over one of them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from fieldkit.estimation.bins import History, RegionColumns
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.disturbances import UNCOOLED_K
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.estimation.shade import ShadeTestMonitor
from fieldkit.estimation.slopes import shaded_rows
from fieldkit.model.samples import Event, EventKind, Quality
from fieldkit.model.slope import SlopeState
from fieldkit.model.units import MINUTE_NS, SECOND_NS
from fieldkit.simulation.boards import Board
from fieldkit.simulation.facets import GROUND
from fieldkit.simulation.faults import cloud_transmission
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS
from fieldkit.simulation.scene_series import EXCHANGE, SceneModel
from fieldkit.simulation.sky import MeasuredSky
from fieldkit.weather import packaged_day
from tests.harness.last_minute import collected

FLAT, B05, B15, B25 = range(4)
LEAD_S = 7200.0


@lru_cache
def afternoon_k(*boards, cloud=()):
    """Surface temperatures (180, 4) of the demo's beds, means of the minutes from noon on.

    Boards are (column, begin, end) in minutes, a cloud is (begin, end).
    """
    day = packaged_day()
    over = tuple(Board(BEDS[bed].name, LEAD_S + 60 * a, LEAD_S + 60 * b) for bed, a, b in boards)
    clouds = [cloud_transmission(*(LEAD_S + 60 * at for at in cloud))] if cloud else []
    model = SceneModel(day.site, MeasuredSky(day), BEDS, GROUND, EXCHANGE, clouds, 3.0, 1.0, over)
    scene = model.series(ALAMOSA_NOON_NS - round(LEAD_S * SECOND_NS), LEAD_S + 10800.0)
    second = LEAD_S + np.arange(0.0, 10800.0, 5.0) + 2.5
    surface = [np.interp(second, scene.time_s, bed) for bed in scene.rows[6 : 6 + len(BEDS)]]
    return np.array(surface).reshape(len(BEDS), 180, -1).mean(axis=2).T


FIVE = (B15, 61 + 1 / 3, 66 + 1 / 3)


def found(kelvin, *, noise_k=0.05, seed=1):
    """Minutes and columns found shaded, and the tests: column, begin and end in minutes."""
    monitor = ShadeTestMonitor()
    noisy = kelvin + noise_k * np.random.default_rng(seed).standard_normal(kelvin.shape)
    tests = [test for minute, row in enumerate(noisy) for test in monitor.update(minute, row, False)]
    ended = [(test.column, test.begin_ns / MINUTE_NS, test.end_ns / MINUTE_NS) for test in tests]
    return monitor.shaded, ended


def cells(column, *minutes):
    return {(minute, column) for minute in minutes}


def test_a_board_is_found_to_the_minute_partly_shaded_ones_included():
    shaded, tests = found(afternoon_k(FIVE))
    assert shaded == cells(B15, *range(61, 67))
    ((column, begin, end),) = tests
    assert column == B15
    assert begin == pytest.approx(61.33, abs=0.15)
    assert end == pytest.approx(66.33, abs=0.15)


def test_one_board_after_another_the_reference_too():
    boards = (FIVE, (FLAT, 80, 85), (B25, 100, 108 + 1 / 6), (B05, 108.5, 115))
    shaded, tests = found(afternoon_k(*boards))
    first = cells(B15, *range(61, 67)) | cells(FLAT, *range(80, 85))
    assert shaded == first | cells(B25, *range(100, 109)) | cells(B05, *range(108, 115))
    assert [test[0] for test in tests] == [B15, FLAT, B25, B05]


def test_two_regions_are_enough():
    shaded, _ = found(afternoon_k(FIVE)[:, [FLAT, B15]])
    assert shaded == cells(1, *range(61, 67))


@pytest.mark.parametrize("noise_k", [0.05, 0.2])
def test_a_clear_afternoon_and_its_gusts_have_no_board(noise_k):
    for seed in range(5):
        assert found(afternoon_k(), noise_k=noise_k, seed=seed) == (set(), [])


def test_a_cloud_is_no_board():
    assert found(afternoon_k(cloud=(60, 66))) == (set(), [])


def test_a_shadow_that_creeps_is_no_board():
    """The mean of a region is that of its strips, which the shadow reaches one after the other."""
    strips = [afternoon_k((B15, 60 + strip, 100)) for strip in range(0, 12, 2)]
    assert found(np.mean(strips, axis=0)) == (set(), [])


def test_a_shadow_that_stays_is_no_test():
    shaded, tests = found(afternoon_k((B15, 60, 100)))
    assert tests == []
    assert shaded == cells(B15, *range(60, 81))


@pytest.mark.parametrize("second", [5, 55, pytest.param(20, marks=pytest.mark.slow)])
def test_under_a_board_a_region_cools_more_than_others_in_its_first_whole_minute(second):
    for boards, cools in (([(B15, 61 + second / 60, 66)], True), ([], False)):
        for seed in range(5):
            monitor, rng = ShadeTestMonitor(), np.random.default_rng(seed)
            for minute, row in enumerate(afternoon_k(*boards)[:63]):
                monitor.update(minute, row + 0.1 * rng.standard_normal(row.size), False)
            assert (monitor.cooling_k(62, B15) > UNCOOLED_K) is cools


def mark(yard, name, at_s, noted_s=None, *, phase="begin", end_s=None):
    at_ns = yard.start_ns + round(at_s * SECOND_NS)
    noted_ns = yard.start_ns + round((at_s if noted_s is None else noted_s) * SECOND_NS)
    data = {"shade_test": name, "noted_ns": noted_ns}
    data |= {"phase": phase} if end_s is None else {"end_ns": yard.start_ns + round(end_s * SECOND_NS)}
    return Event(EventKind.MARK, at_ns + 7, at_ns, "shade-test", data=data)


def flagged(history, column):
    rows = np.flatnonzero(history.is_shaded()[:, column])
    return (history.minute[rows] - history.minute[0]).tolist()


def live(yard, samples, marks):
    """Bins and their events where each mark comes when it is made."""
    items = [(mark.data["noted_ns"], mark) for mark in marks]
    items = sorted([*items, *((sample.time_ns, sample) for sample in samples)], key=lambda item: item[0])
    _, closed = collected(yard, (item for _, item in items))
    return [entry for entry, _ in closed], [events for _, events in closed]


def slopes(yard, bins):
    return SlopeChain(yard.beds, EstimatorSettings(model="paper")).at(History.of(bins)).slopes


@pytest.mark.parametrize(
    ("told", "minutes"),
    [
        pytest.param(
            [("b17", 605, None, "begin"), ("b17", 890, None, "end")], range(10, 15), marks=pytest.mark.slow
        ),
        ([("b17", 605, 800, "begin"), ("b17", 890, 1300, "end")], range(10, 15)),
        ([("b17", 605, None, "begin")], range(10, 25)),
        ([("flat", 605, None, "begin"), ("flat", 725, None, "end")], range(10, 13)),
    ],
)
def test_marks_shade_their_minutes_live_as_in_batch(yard, told, minutes):
    noisy = replace(yard, noise_k=0.05)
    samples = noisy.samples(25)
    marks = [mark(yard, name, at_s, noted_s, phase=phase) for name, at_s, noted_s, phase in told]
    bins, events = live(noisy, samples, marks)
    column = [bed.name for bed in yard.beds].index(told[0][0])
    history = History.of(bins)
    assert flagged(history, column) == list(minutes)
    _, batch = collected(yard, [*marks, *samples])  # a batch has all marks from the start
    assert repr(batch) == repr(list(zip(bins, events, strict=True)))
    for last in range(1, len(history) + 1):
        then = History.of(bins[:last])
        assert np.array_equal(history.until(last).is_shaded(), then.is_shaded())


def test_an_interval_told_afterwards_shades_the_minutes_before(yard):
    marks = [mark(yard, "b17", 605, 1210, end_s=890)]
    history = History.of(live(yard, yard.samples(25), marks)[0])
    assert flagged(history.until(20), 2) == []
    assert flagged(history.until(21), 2) == list(range(10, 15))
    assert flagged(history, 2) == list(range(10, 15))


def test_a_shade_test_ends_by_itself_and_one_that_cools_nothing_is_reported(yard):
    begun = mark(yard, "b17", 605)
    begun = replace(begun, data={**begun.data, "for_s": 240.0})
    bins, events = live(replace(yard, noise_k=0.05), yard.samples(25), [begun])
    assert flagged(History.of(bins), 2) == list(range(10, 15))
    ((minute, text),) = (
        (n, event.text) for n, each in enumerate(events) for event in each if "uncooled" in event.data
    )
    assert minute == 11
    assert text.startswith("b17 ")


def test_a_mark_taken_back_while_recording_shades_no_minute(yard):
    begun, other = mark(yard, "b17", 605), mark(yard, "b05", 610)
    back = Event(EventKind.MARK, 0, begun.time_ns, "taken back", data={"corrects": 1, "takes_back": 1})
    back.data["noted_ns"] = yard.start_ns + 700 * SECOND_NS
    history = History.of(live(yard, yard.samples(25), [begun, other, back])[0])
    assert flagged(history.until(11), 2) == [10]
    assert flagged(history, 2) == []


def test_while_the_reference_is_shaded_every_slope_is_held(yard):
    marks = [mark(yard, "flat", 605), mark(yard, "flat", 720, phase="end")]
    bins, _ = live(yard, yard.samples(15), marks)
    held = slopes(yard, bins[:12])
    assert {one.state for one in held} == {SlopeState.SHADED}
    assert all("reference" in one.reason for one in held)
    assert held[0].tilt_deg == slopes(yard, bins[:10])[0].tilt_deg
    columns = RegionColumns(tuple(yard.beds))
    shaded = shaded_rows(History.of(bins), columns, columns.targets[:1])
    assert np.flatnonzero(shaded[:, 0]).tolist() == [10, 11]


def test_a_mark_about_an_unknown_region_changes_nothing(yard):
    bins, _ = live(yard, yard.samples(8), [mark(yard, "elsewhere", 120)])
    assert not History.of(bins).is_shaded().any()


def test_the_hour_after_sunset_is_binned_and_announced_once(yard):
    dusk = replace(yard, start_ns=yard.start_ns + 9 * 3600 * SECOND_NS, dni_w_m2=0.0, noise_k=0.05)
    bins, events = live(dusk, dusk.samples(60), [])
    (event,) = (event for reported in events for event in reported)
    assert "an hour" in event.text
    assert len(bins) == 60
    assert np.isfinite([entry.temperature_k for entry in bins]).all()
    assert all(entry.flags & Quality.LOW_SUN for entry in bins)
    assert {slope.state for slope in slopes(dusk, bins)} == {SlopeState.LOW_SUN}
