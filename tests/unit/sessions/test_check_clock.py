"""What the clock comparisons of a session say, and the time map that follows from them."""

from pathlib import Path

import numpy as np
import pytest

from fieldkit.model.clock import ClockCheck
from fieldkit.model.next_step import Action, Text
from fieldkit.model.samples import Quality
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.check import check
from fieldkit.sessions.finished_file import apply_time_map, propose_time_map
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from tests.harness.findings import said
from tests.harness.recording import START_NS, CountedClock, header, sample

HEADER = header((24, 32))
STEADY = [n * 111_111_111 for n in range(60)]


def recorded(path: Path, times_ns: list[int], checks: list[ClockCheck]) -> Path:
    """A session of one camera with frames at these monotonic times, and these comparisons."""
    clock = CountedClock()
    writer = SessionWriter(path, HEADER, clock)
    for seq, mono_ns in enumerate(times_ns):
        writer.append(sample(HEADER.streams[0], seq, mono_ns, clock.to_utc_ns(mono_ns)))
    for compared in checks:
        writer.put(compared)
    writer.close()
    return path


def test_stepped_clock_is_found_and_a_time_map_proposed_and_applied(tmp_path):
    anchor = START_NS + 123
    month_ns = 27 * 86_400_000_000_000
    checks = [
        ClockCheck(0, anchor, 50),
        ClockCheck(3_000_000_000, anchor, 50),
        ClockCheck(4_000_000_000, anchor + month_ns, 50),
    ]
    path = recorded(tmp_path / "a.h5", STEADY, checks)
    assert "+2332800.000 s" in said(path, "clock")
    with open_session(path) as session:
        before = [frame.time_ns for frame in session.samples()]
        steps = propose_time_map(session)
    assert [(step.mono_ns, step.add_ns) for step in steps] == [(0, month_ns)]
    apply_time_map(path, steps)
    apply_time_map(path, steps)
    with open_session(path) as session:
        assert session.time_map() == steps
        assert [frame.time_ns for frame in session.samples()] == [time + month_ns for time in before]
        assert not any(frame.quality & Quality.BAD_CRC for frame in session.samples())
    assert said(path, "camera", "fail") == ""
    assert "+2332800.000 s" in said(path, "clock", "ok")


ANCHOR_NS = START_NS + 123
AWAKE_NS = 5
"""Of the computer before the session: it had not slept but for the jitter of two readings."""


def slept_between(path: Path, before_s: int, after_s: int, slept_s: int, stepped_s: int = 0) -> Path:
    """One picture a second; the clocks compared each minute and beside a sleep, as Linux would have it.

    There UTC goes on while the monotonic clock stands: their difference grows by the time slept.
    """
    checks = []
    for at_s in sorted({0, 60, before_s, after_s, 120, 180}):
        slept_ns = slept_s * SECOND_NS * (at_s >= after_s)
        offset_ns = ANCHOR_NS + slept_ns + stepped_s * SECOND_NS * (at_s >= 60)
        checks.append(ClockCheck(at_s * SECOND_NS, offset_ns, 50, suspended_ns=AWAKE_NS + slept_ns))
    return recorded(path, [n * SECOND_NS for n in range(200)], checks)


def added_s(path: Path) -> np.ndarray:
    """What the proposed time map, once applied, adds to each picture, in seconds."""
    with open_session(path) as session:
        steps = propose_time_map(session)
    apply_time_map(path, steps)
    with open_session(path) as session:
        return (session.times_ns("camera") - session.stream("camera").time_ns(recorded=True)) / 1e9


def test_sleep_asks_for_a_map_from_there_on(tmp_path):
    path = slept_between(tmp_path / "a.h5", 100, 101, 660)
    assert "slept for 11 min" in said(path, "clock")
    assert "stepped" not in said(path, "clock")
    added = added_s(path)
    assert set(added[:100]) == {0.0}  # the sleep began after picture 100
    assert set(added[101:]) == {660.0}
    assert said(path, "clock") == ""  # nothing is left to be done
    assert "slept for 11 min" in said(path, "clock", "ok")


def test_sleep_and_a_step_are_corrected_together(tmp_path):
    path = slept_between(tmp_path / "a.h5", 100, 101, 660, stepped_s=3600)
    assert "+3600.000 s" in said(path, "clock")
    added = added_s(path)
    assert set(added[:100]) == {3600.0}
    assert set(added[101:]) == {4260.0}


def stepped_by(path: Path, *offsets_s: float) -> Path:
    """A session whose clock comparisons, from second 5 on, found these distances from the recorded times."""
    checks = [
        ClockCheck((5 + 60 * n) * SECOND_NS, ANCHOR_NS + round(offset_s * 1e9), 50)
        for n, offset_s in enumerate(offsets_s)
    ]
    return recorded(path, STEADY, checks)


def advice(path: Path) -> list[Text]:
    return [one.fix for one in check(path) if one.what == "clock" and one.fix]


def test_clock_stepped_before_the_first_comparison_is_corrected_too(tmp_path):
    path = stepped_by(tmp_path / "a.h5", 3600, 3600, 3600)
    assert "+3600.000 s" in said(path, "clock")
    assert advice(path) == [Action.CORRECT_CLOCK(path)]
    assert set(added_s(path)) == {3600.0}


@pytest.mark.parametrize("offsets_s", [(0, 3600, 3600), (3600, 3600)])
def test_applied_time_map_is_not_advised_again(tmp_path, offsets_s):
    path = stepped_by(tmp_path / "a.h5", *offsets_s)
    assert advice(path)
    added_s(path)
    assert advice(path) == []


def test_no_time_map_is_advised_where_none_would_be_proposed(tmp_path):
    path = stepped_by(tmp_path / "a.h5", 0, 0.9, 1.8, 2.7)  # drifts, but was never stepped
    assert "+2.700 s" in said(path, "clock")
    assert advice(path) == []


def test_a_comparison_of_long_before_the_end_is_not_taken_for_one_of_the_end(tmp_path):
    checks = [ClockCheck(n * 60 * SECOND_NS, ANCHOR_NS, 50) for n in range(2)]
    path = recorded(tmp_path / "a.h5", [0, SECOND_NS, 7260 * SECOND_NS], checks)
    assert "2 h 00 min" in said(path, "clock", "ok")
