"""Minutes from the cache are those of the estimator, field by field, and only of the very same file."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import pytest

from fieldkit.sessions.reader import open_session
from fieldkit.workflows import known_minutes
from fieldkit.workflows.check import check
from fieldkit.workflows.estimate import estimate, estimator_for, minutes_of
from fieldkit.workflows.known_minutes import KnownMinutes
from fieldkit.workflows.sources import config_for


@pytest.fixture
def never_read(monkeypatch):
    """From the call on, reading the samples of a session fails."""

    def unexpected(*_: object) -> None:
        raise AssertionError("the session was read again")

    return lambda: monkeypatch.setattr(known_minutes, "closed_minutes", unexpected)


def found(path: Path, model: str | None = None) -> list[str]:
    with open_session(path) as session:
        return [exact(one) for one in KnownMinutes(session, config_for(session)).minutes(model)]


def exact(minute: object) -> str:
    """Every field with every digit; `Minute` has a short repr of its own."""
    return repr({name: getattr(minute, name) for name in type(minute).__slots__})  # type: ignore[attr-defined]


def by_the_estimator(path: Path, *settings: str) -> list[str]:
    with open_session(path) as session:
        estimator = estimator_for(session, config_for(session, settings))
        return [exact(one) for one in minutes_of(session, estimator)]


def test_equal_to_the_estimators_when_read_and_when_known(sessions, never_read):
    expected = by_the_estimator(sessions[0])
    assert found(sessions[0]) == expected
    never_read()
    assert found(sessions[0]) == expected


@pytest.mark.parametrize("model", ["paper", "full"])
def test_slopes_by_another_model(sessions, model):
    assert found(sessions[0], model) == by_the_estimator(sessions[0], f'estimator.model="{model}"')


def test_check_reads_nothing_that_estimate_and_report_know(sessions, never_read):
    found(sessions[0])
    never_read()
    assert check(sessions[0]).level == "ok"
    assert len(estimate(sessions[0])) > 0


def test_a_slope_that_was_changed_afterwards_is_found(sessions, tmp_path):
    copy = tmp_path / "copy.h5"
    copy.write_bytes(sessions[0].read_bytes())
    (before,) = slopes_found(copy)
    with h5py.File(copy, "r+") as file:
        (tilts,) = (one for one in _datasets(file["estimates"]) if one.name.endswith("/tilt_deg"))
        tilts[-1, -1] += 0.001
    (after,) = slopes_found(copy)
    assert after == f"1 of {before.replace('the same', 'differently')}"


def slopes_found(path: Path) -> list[str]:
    return [one.text for one in check(path).findings if one.what == "slopes"]


def _datasets(group):
    found = []
    group.visititems(lambda _, one: found.append(one) if isinstance(one, h5py.Dataset) else None)
    return found


def test_damaged_samples_are_told_of_again(sessions, tmp_path, never_read):
    copy = tmp_path / "copy.h5"
    copy.write_bytes(sessions[0].read_bytes())
    with h5py.File(copy, "r+") as file:
        (crc,) = (one for one in _datasets(file) if re.search("lux.*/crc32$", one.name))
        crc[5] ^= 1
    told = []
    for _ in range(2):
        with open_session(copy) as session:
            told.append(dict(KnownMinutes(session, config_for(session)).damaged))
        never_read()
    assert told == [{"lux": 1}, {"lux": 1}]
