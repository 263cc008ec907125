"""What the wizard of an emissivity day shows and when it ends, on probes and pictures made by hand."""

from __future__ import annotations

import signal
from types import SimpleNamespace
from typing import Any, cast

import pytest

from fieldkit.cli.calibrate_emissivity_live import SteadyView, apart
from fieldkit.cli.calibrate_gather import Gathering
from fieldkit.estimation.estimator import Minute
from tests.unit.cli.test_gather import frame, made, reading


def plateau(start_s: int, kelvin: float, view: SteadyView) -> None:
    """Six minutes of a surface and a probe that stay where they are."""
    for second in range(start_s, start_s + 360, 5):
        if second % 20 == 0:
            view.show(frame(second, sand=kelvin - 4.0, foil=240.0))
        view.show(reading(second, kelvin, kelvin, 290.0))


@pytest.fixture
def minute() -> Minute:
    return cast(Minute, object.__new__(Minute))


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Signals raised to end the recording."""
    raised: list[int] = []
    monkeypatch.setattr(signal, "raise_signal", raised.append)
    return raised


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    lines: list[str] = []
    from fieldkit.cli import calibrate_emissivity_live as live

    monkeypatch.setattr(live, "common", SimpleNamespace(say=lines.append))
    return lines


def test_temperatures_closer_than_five_kelvin_count_once() -> None:
    assert apart([300.0, 301.0, 304.9, 305.0, 309.0, 311.0]) == [300.0, 305.0, 311.0]


def test_the_recording_is_sealed_at_the_wanted_number_of_temperatures_and_not_before(
    minute: Minute, ended: list[int], said: list[Any]
) -> None:
    view = SteadyView(Gathering(made()), 2)
    plateau(0, 300.0, view)
    view.show(minute)
    assert ended == []
    assert "temperatures 1 of 2, span 0 K" in said[-1]
    assert "26.8 °C" in said[-1] or "26.9 °C" in said[-1]
    assert "steady" in said[-1]
    plateau(600, 310.0, view)
    view.show(minute)
    assert ended == [signal.SIGTERM]
    assert "temperatures 2 of 2, span 10 K" in said[-1]
    view.close()


def test_without_a_picture_the_wizard_says_what_is_missing(
    minute: Minute, ended: list[int], said: list[Any]
) -> None:
    SteadyView(Gathering(made()), 2).show(minute)
    assert "no usable pictures" in said[-1]
    assert ended == []
