"""Minutes from the cache are those of the estimator, field by field, and only of the very same file."""

import random
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import fieldkit
from fieldkit.config import changed_config, load_config
from fieldkit.model.errors import NoAnswerError
from fieldkit.results import minutes as minutes_service
from fieldkit.results.check import check
from fieldkit.results.estimate import estimate
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.sources import config_for
from fieldkit.sessions.file_tree import LIBVER
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from fieldkit.simulation.simulated_clock import SimulatedClock
from tests.harness.command_line import run_code
from tests.harness.faults import change_header
from tests.harness.replayed_minutes import replayed_minutes

pytestmark = pytest.mark.usefixtures("cache_folder")


@pytest.fixture
def never_read(monkeypatch):
    """From the call on, reading the samples of a session fails."""

    def unexpected(*_: object) -> None:
        raise AssertionError("the session was read again")

    # a file that cannot be read would have another checksum, and so no cached minutes
    return lambda: monkeypatch.setattr(minutes_service, "measure", unexpected)


def found(path: Path, model: str | None = None) -> list[str]:
    with open_session(path) as session:
        return [exact(one) for one in SessionMinutes(session, config_for(session)).minutes(model)]


def exact(minute: object) -> str:
    """Every field with every digit; `Minute` has a short repr of its own."""
    return repr({name: getattr(minute, name) for name in type(minute).__slots__})  # type: ignore[attr-defined]


def by_the_estimator(path: Path, *settings: str) -> list[str]:
    with open_session(path) as session:
        minutes = replayed_minutes(session, config_for(session, settings))
        return [exact(minute) for minute in minutes]


def test_equal_to_the_estimators_when_read_and_when_known(sessions, never_read):
    expected = by_the_estimator(sessions[0])
    assert found(sessions[0]) == expected
    never_read()
    assert found(sessions[0]) == expected


def recorded(folder: Path, own: Path) -> Path:
    """A session of six minutes whose recording ended in this process."""
    shutil.copytree(folder, own, ignore=shutil.ignore_patterns("*.h5"))
    config = changed_config(load_config(own / "fieldkit.toml"), ["simulation.speed=max"])
    with fieldkit.record(config, duration="6m") as session:
        return session.path


def test_first_check_and_report_use_the_recordings_own_minutes(folder, tmp_path, never_read):
    path = recorded(folder, tmp_path / "own")
    expected = by_the_estimator(path)
    changed = shutil.copy(path, tmp_path)
    with h5py.File(changed, "r+", libver=LIBVER) as file:
        file.attrs["note"] = "changed"
    computed_again = slopes_found(changed)
    never_read()
    assert slopes_found(path) != computed_again
    assert "as recorded" in fieldkit.report(path).path.read_text("utf-8")
    numbers = re.compile(r"-?\d+\.\d+(?:e[-+]?\d+)?")
    for own, again in zip(found(path), expected, strict=True):
        assert numbers.sub("", own) == numbers.sub("", again)
        one, other = (np.array(numbers.findall(text), float) for text in (own, again))
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    with open_session(path) as session:
        budgets = SessionMinutes(session, config_for(session)).estimates().budgets
    assert budgets.keys() == estimate(path).final.keys()
    for terms in budgets.values():
        assert sum(term.share for term in terms) == pytest.approx(1.0)


@pytest.mark.parametrize("model", ["paper", "full"])
def test_slopes_by_another_model(sessions, model, never_read):
    assert found(sessions[0], model) == by_the_estimator(sessions[0], f'estimator.model="{model}"')
    budgets = estimate(sessions[0], model=model).budgets
    assert budgets
    never_read()
    assert estimate(sessions[0], model=model).budgets == budgets


def test_a_check_whose_slopes_are_known_does_without_scipy(sessions):
    """It takes as long to import as the check itself takes."""
    found(sessions[0])
    code = "import sys, fieldkit; fieldkit.check(sys.argv[1]); print('scipy' in sys.modules)"
    assert run_code(code, sessions[0]).split() == ["False"]


def test_a_slope_that_was_changed_afterwards_is_found(sessions, tmp_path):
    copy = tmp_path / "copy.h5"
    copy.write_bytes(sessions[0].read_bytes())
    (before,) = slopes_found(copy)
    with h5py.File(copy, "r+") as file:
        (tilts,) = (one for one in _datasets(file["estimates"]) if one.name.endswith("/tilt_deg"))
        tilts[-1] += 0.001
    (after,) = slopes_found(copy)
    assert before != after
    assert after.startswith("1 of ")


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
            told.append(dict(SessionMinutes(session, config_for(session)).measured.damaged))
        never_read()
    assert told == [{"lux": 1}, {"lux": 1}]


HOSTILE = [-1, 0, 7, 1e308, float("nan"), "", "x", "\0", None, [], {}, [1], 2**70, True]


def places(node: object, at: tuple[object, ...] = ()) -> Iterator[tuple[object, ...]]:
    """Where the values of a document are, those that hold others included."""
    parts = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in parts:
        yield (*at, key)
        yield from places(value, (*at, key))


def with_header(session: Path, change: Callable[[Any], object], path: Path) -> Path:
    """A copy of a session that has another header."""
    shutil.copy(session, path)
    with h5py.File(path, "r+", libver=LIBVER) as file:
        change_header(file, change)
    return path


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 24))]
)
def test_hostile_header_is_a_finding(sessions, tmp_path, seed):
    """No header ends the check: what is wrong with it is among the findings."""

    def change(header: Any) -> None:
        chance = random.Random(seed)
        *way, last = chance.choice(list(places(header)))
        for key in way:
            header = header[key]
        header[last] = chance.choice(HOSTILE)

    assert check(with_header(sessions[0], change, tmp_path / "a.h5")).level == "fail"


def test_header_with_fewer_regions_than_the_tables_is_a_finding(sessions, tmp_path):
    path = with_header(sessions[0], lambda header: header["regions"].pop(), tmp_path / "a.h5")
    assert ("file", "fail") in {(finding.what, finding.level) for finding in check(path).findings}


def test_configuration_that_cannot_be_used_is_a_finding(sessions, tmp_path):
    def change(header: Any) -> None:
        header["config_toml"] = "schema = ["

    findings = check(with_header(sessions[0], change, tmp_path / "a.h5")).findings
    assert "slopes" in [finding.what for finding in findings]


def test_a_session_without_a_sample_has_no_slopes_and_every_result_says_so(sessions, tmp_path):
    """What a recording is in its first seconds, when somebody already follows it."""
    path = tmp_path / "empty.h5"
    with open_session(sessions[0]) as session:
        SessionWriter(path, session.header, SimulatedClock(session.identity.start_ns)).close()
    with pytest.raises(NoAnswerError, match="window='all'"):
        fieldkit.slope_map(path)
    assert not fieldkit.estimate(path).minutes
    assert not fieldkit.report(path).failures
