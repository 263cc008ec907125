"""A recording is killed; its slopes, estimated again from what was recovered, are those it had stored."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fieldkit.config.template import SIMULATED
from fieldkit.model.errors import SessionError
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate
from fieldkit.recording.campaign import create_campaign
from fieldkit.results.sources import config_for
from fieldkit.sessions.journal_reader import JournalReader
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.records import MinuteRecord
from tests.harness.replayed_minutes import replayed_minutes
from tests.harness.seldom import SET_SELDOM
from tests.harness.waiting import wait_until

FIELDKIT = (sys.executable, "-m", "fieldkit")
RECORD = ("record", "--for", "3h", "--set", "simulation.speed=max", *SET_SELDOM, "-q")
MINUTES = 8
LIMIT_S = 300.0
"""A busy computer is no failure; only what hangs is ended."""


def stored_estimates(journal: Path) -> list[SlopeEstimate]:
    """What the estimator had said, as the journal has it."""
    try:
        with JournalReader(journal) as reader:
            minutes = [entry for entry in reader.entries() if isinstance(entry, MinuteRecord)]
    except SessionError:
        return []  # not begun yet
    return [estimate for minute in minutes for estimate in minute.estimates]


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A session killed after some minutes and recovered, and the slopes it had stored before."""
    folder = tmp_path_factory.mktemp("killed") / "field"
    create_campaign(folder, SIMULATED)
    process = subprocess.Popen([*FIELDKIT, *RECORD, "-C", str(folder)])
    try:
        journal = wait_for_minutes(folder / "recordings")
    finally:
        process.kill()
        process.wait()
    before = stored_estimates(journal)
    subprocess.run([*FIELDKIT, "recover", "-C", str(folder)], check=True, capture_output=True)
    return journal.with_name(journal.name.removesuffix(".journal")), before


def wait_for_minutes(recordings: Path) -> Path:
    def enough() -> list[Path]:
        journals = recordings.glob("*.journal")
        return [journal for journal in journals if len(stored_estimates(journal)) >= 3 * MINUTES]

    wait_until(enough, f"no {MINUTES} minutes were recorded in {LIMIT_S:.0f} s", LIMIT_S, every_s=0.25)
    return enough()[0]


def assert_equal(ones: list[SlopeEstimate], others: list[SlopeEstimate]) -> None:
    assert [(one.time_ns // 1000, one.region, one.state) for one in ones] == [
        (other.time_ns // 1000, other.region, other.state) for other in others
    ]
    for name in SLOPE_FIELDS:
        expected = [getattr(other, name) for other in others]
        np.testing.assert_allclose([getattr(one, name) for one in ones], expected, rtol=0, atol=1e-9)


def test_recovered_session_has_the_slopes_that_were_stored(killed):
    path, before = killed
    assert not journal_path(path).exists()
    with open_session(path) as session:
        assert session.state == "recovered"
        assert_equal(session.estimates(), before)


def test_slopes_estimated_again_are_those_that_were_stored(killed):
    path, before = killed
    with open_session(path) as session:
        minutes = replayed_minutes(session, config_for(session))
    again = [one for minute in minutes for one in minute.estimates]
    assert any(np.isfinite(one.tilt_deg) for one in before)
    assert len(again) >= len(before)  # the minute under way when it was killed comes out too
    assert_equal(again[: len(before)], before)
