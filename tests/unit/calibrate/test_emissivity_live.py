"""What a recording for an emissivity reports and when it ends, on synthetic probes and frames."""

import threading
from typing import cast

import pytest

from fieldkit.calibrate.emissivity_live import SteadyView, apart
from fieldkit.calibrate.measurement import ReadingCollector
from fieldkit.estimation.estimator import Minute
from tests.unit.calibrate.test_measurement import frame, made, reading


def plateau(start_s: int, kelvin: float, view: SteadyView) -> None:
    """Six minutes of a surface and a probe that stay where they are."""
    for second in range(start_s, start_s + 360, 5):
        if second % 20 == 0:
            view.show(frame(second, sand=kelvin - 4.0, foil=240.0))
        view.show(reading(second, kelvin, kelvin, 290.0))


@pytest.fixture
def minute():
    return cast(Minute, object.__new__(Minute))


def test_temperatures_closer_than_five_kelvin_count_once():
    assert apart([300.0, 301.0, 304.9, 305.0, 309.0, 311.0]) == [300.0, 305.0, 311.0]


def test_the_recording_is_sealed_at_the_wanted_number_of_temperatures_and_not_before(minute):
    said, ended = list[str](), threading.Event()
    view = SteadyView(ReadingCollector(made()), said.append, ended.set, 2)
    plateau(0, 300.0, view)
    view.show(minute)
    assert not ended.is_set()
    assert "1 of 2" in said[-1]
    assert "26.8 °C" in said[-1] or "26.9 °C" in said[-1]
    assert "steady" in said[-1]
    plateau(600, 310.0, view)
    view.show(minute)
    assert ended.is_set()
    assert "2 of 2" in said[-1]
    assert "10 K" in said[-1]
    view.close()


def test_without_a_frame_the_recording_reports_what_is_missing(minute):
    said, ended = list[str](), threading.Event()
    SteadyView(ReadingCollector(made()), said.append, ended.set, 2).show(minute)
    assert "frames" in said[-1]
    assert not ended.is_set()
