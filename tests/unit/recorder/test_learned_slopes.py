"""Slopes and what was learnt: stored while recording, again from the file, in batch and after recovery."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from fieldkit.cli import main
from fieldkit.model.learnt import Learnt
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate
from fieldkit.results.estimate import estimate
from fieldkit.results.sources import config_for
from fieldkit.sessions.reader import SessionReader, open_session
from tests.harness.replayed_minutes import replayed_minutes
from tests.harness.seldom import SET_SELDOM


def recorded(folder: Path, name: str) -> Path:
    words = ("--for", "12m", "--name", name, "-q", "--set", "simulation.speed=max", *SET_SELDOM)
    CliRunner().invoke(main, ["record", "-C", str(folder), *words, "--set", "estimator.model=learned"])
    (path,) = (folder / "recordings").glob(f"*{name}*.h5")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("learned")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_CONFIG_HOME", str(made / "home"))
        patched.setenv("XDG_CACHE_HOME", str(made / "cache"))
        assert CliRunner().invoke(main, ["init", "--simulated", str(made / "sand")]).exit_code == 0
    return made / "sand"


@pytest.fixture(scope="module")
def whole(folder):
    return recorded(folder, "whole")


def again(session: SessionReader) -> tuple[list[SlopeEstimate], list[Learnt | None]]:
    minutes = replayed_minutes(session, config_for(session))
    return [one for minute in minutes for one in minute.estimates], [minute.learnt for minute in minutes]


def assert_equal(ones: list[SlopeEstimate], others: list[SlopeEstimate]) -> None:
    assert [(one.time_ns // 1000, one.region, one.state, one.model) for one in ones] == [
        (other.time_ns // 1000, other.region, other.state, other.model) for other in others
    ]
    for name in SLOPE_FIELDS:
        expected = [getattr(other, name) for other in others]
        np.testing.assert_allclose([getattr(one, name) for one in ones], expected, rtol=0, atol=1e-9)


def test_live_slopes_are_those_of_a_replay_and_of_the_batch(whole):
    with open_session(whole) as session:
        stored = session.estimates()
        replayed, learnt = again(session)
        kept = list(session.learnt().values())
    assert all(one.model.startswith("learned") for one in stored)
    assert sum(np.isfinite(one.tilt_deg) for one in stored) >= 3 * 6
    assert_equal(replayed, stored)
    assert_equal(list(estimate(whole)), stored)
    for found, expected in zip([one for one in learnt if one is not None], kept, strict=True):
        values = [[one.value for one in each.parameters] for each in (found, expected)]
        assert values[0] == pytest.approx(values[1], rel=1e-9)
