"""`check` finds each kind of trouble, and only that."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from fieldkit.model.clock import ClockCheck
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.next_step import Action, Text
from fieldkit.model.samples import Event, EventKind, Quality, Severity
from fieldkit.model.site import Site
from fieldkit.model.units import SECOND_NS
from fieldkit.sessions.check import best_shift_min, check
from fieldkit.sessions.finished_file import apply_time_map, propose_time_map
from fieldkit.sessions.reader import open_session
from tests.harness.faults import flip_byte
from tests.harness.findings import said
from tests.harness.recording import START_NS, header, interrupted, sample, session_of
from tests.shared_data import shared

HEADER = header((24, 32))
CAMERA, LUX, _ = HEADER.streams
STEP_NS = 111_111_111


def recorded(
    path: Path,
    times_ns: list[int],
    flags: dict[int, Quality] | None = None,
    camera: StreamInfo = CAMERA,
    entries: Sequence[Event | ClockCheck] = (),
) -> Path:
    """A session of one camera with frames at these monotonic times, their flags, and other entries."""
    frames = [
        sample(camera, seq, mono)._replace(quality=(flags or {}).get(seq, Quality.GOOD))
        for seq, mono in enumerate(times_ns)
    ]
    return session_of(path, replace(HEADER, streams=(camera, *HEADER.streams[1:])), *frames, *entries)


STEADY = [n * STEP_NS for n in range(60)]


def test_steady_camera_has_nothing_against_it(tmp_path):
    path = recorded(tmp_path / "a.h5", STEADY)
    assert said(path, "camera") == ""
    assert "60 samples" in said(path, "camera", "ok")
    assert said(path, "state", "ok")


def test_camera_that_corrects_for_emissivity_is_found(tmp_path):
    corrects = replace(CAMERA, settings={"emissivity": 0.98})
    path = recorded(tmp_path / "a.h5", STEADY, camera=corrects)
    assert "0.98" in said(path, "camera")


def test_gap_and_order_and_bunches_are_found(tmp_path):
    gap = [n * STEP_NS + (n > 30) * 14_000_000_000 for n in range(60)]
    assert "14.1 s" in said(recorded(tmp_path / "gap.h5", gap), "camera")
    back = [*STEADY[:30], STEADY[20], *STEADY[31:]]
    assert "out of order" in said(recorded(tmp_path / "back.h5", back), "camera", "fail")
    bunches = [(n // 3) * 3 * STEP_NS + (n % 3) * 1_000_000 for n in range(60)]
    assert "bunches" in said(recorded(tmp_path / "bunches.h5", bunches), "camera")


def test_bursts_have_no_gaps_until_a_minute_is_missing(tmp_path):
    def minutes(chosen: list[int]) -> list[int]:
        return [minute * 60_000_000_000 + n * STEP_NS for minute in chosen for n in range(3)]

    assert "gaps" not in said(recorded(tmp_path / "a.h5", minutes(list(range(20)))), "camera")
    missing = [n for n in range(24) if n not in (10, 11, 12)]
    assert "4 min 00 s" in said(recorded(tmp_path / "b.h5", minutes(missing)), "camera")


def test_flags_are_counted(tmp_path):
    path = recorded(tmp_path / "a.h5", STEADY, {3: Quality.FROZEN, 4: Quality.FROZEN, 9: Quality.SHUTTER})
    assert "flagged frozen" in said(path, "camera")
    assert "flagged shutter" in said(path, "camera", "ok")


def test_frames_lost_on_the_way_are_counted(tmp_path):
    frames = [
        sample(CAMERA, seq, mono)._replace(device_seq=seq + 2 * (seq > 30), quality=Quality.GOOD)
        for seq, mono in enumerate(STEADY)
    ]
    frames[31] = frames[31]._replace(quality=Quality.DROPPED_BEFORE)
    assert "2 samples" in said(session_of(tmp_path / "a.h5", HEADER, *frames), "camera")


def test_light_brighter_than_the_sun_is_not_plausible(tmp_path):
    """The brightest sun gives some 130 000 lx."""
    readings = (sample(LUX, seq, seq * 10**9)._replace(values=(300_000.0,)) for seq in range(5))
    assert "first 300000 lx" in said(session_of(tmp_path / "a.h5", HEADER, *readings), "lux")


LEVELS = {
    EventKind.LOST: (Severity.ERROR, "warn"),
    EventKind.GARBLED: (Severity.WARNING, "warn"),
    EventKind.CLOUD: (Severity.WARNING, "warn"),
    EventKind.DISK: (Severity.ERROR, "warn"),
    EventKind.MARK: (Severity.INFO, "ok"),
}


def test_events_are_summed_up(tmp_path):
    events = [
        Event(kind, n, START_NS, f"{kind.name} {n}", "lux", severity)
        for kind, (severity, _) in LEVELS.items()
        for n in range(3)
    ]
    found = {one.what: one for one in check(recorded(tmp_path / "a.h5", STEADY, entries=events))}
    for kind, (_, level) in LEVELS.items():
        one = found[f"{kind.name.lower()} lux"]
        assert (one.level, f"{kind.name} 0, and 2 more" in one.text) == (level, True), kind


def test_changed_byte_of_a_picture_is_found(tmp_path):
    path = recorded(tmp_path / "a.h5", STEADY)
    with h5py.File(path) as file:
        place = file["camera/counts"].id.get_chunk_info(2).byte_offset
    flip_byte(path, place + 40, 0x10)
    assert "first number 18" in said(path, "camera", "fail")
    with open_session(path) as session:
        bad = [frame.seq for frame in session.samples("camera") if frame.quality & Quality.BAD_CRC]
        assert bad == list(range(18, 27))  # the third block, and no other frame


def test_changed_byte_of_a_table_is_found(tmp_path):
    path = recorded(tmp_path / "a.h5", STEADY, entries=[Event(EventKind.MARK, 1, START_NS, "here")])
    with h5py.File(path) as file:
        place = file["events/text"].id.get_chunk_info(0).byte_offset
    flip_byte(path, place, ord("h") ^ ord("H"))
    assert said(path, "events/text", "fail")


def test_unfinished_session_gets_no_time_map(tmp_path):
    interrupted(tmp_path / "a.h5", HEADER, 0)
    with pytest.raises(SessionError, match=r"(?s)a\.h5.*recover\("):
        apply_time_map(tmp_path / "a.h5", [])
    assert "journal" in said(tmp_path / "a.h5", "state", "fail")


def test_no_file_is_a_finding_not_an_exception(tmp_path):
    (finding,) = check(tmp_path / "nothing.h5")
    assert (finding.level, finding.what) == ("fail", "file")


def alamosa() -> tuple[np.ndarray, np.ndarray]:
    """Global irradiance of a real day times 110 lm/W: NOAA SURFRAD, Alamosa, 2016-01-01."""
    rows = np.loadtxt(shared("data/weather/slv16001.dat"), skiprows=2)
    day = np.datetime64("2016-01-01", "ns").astype(np.int64)
    time_ns = day + (rows[:, 4] * 3600 + rows[:, 5] * 60).astype(np.int64) * 1_000_000_000
    return time_ns, np.clip(rows[:, 8], 0, None) * 110.0


@pytest.mark.parametrize("wrong_min", [0, 60, -60, 540, -420])
def test_wrong_zone_is_seen_in_three_hours_of_a_real_day(wrong_min):
    time_ns, lux = alamosa()
    hours = time_ns // 3_600_000_000_000 % 24
    chosen = (hours >= 18) & (hours < 21)
    site = Site(37.6969, -105.923, 2317.0)  # the station's header
    shifted = time_ns[chosen] + wrong_min * 60_000_000_000
    assert best_shift_min(shifted, lux[chosen], site) == -wrong_min


def test_night_and_short_sessions_say_nothing_about_the_sun():
    site = Site(37.6969, -105.923, 2317.0)
    minutes = START_NS + np.arange(200, dtype=np.int64) * 60_000_000_000
    assert best_shift_min(minutes, np.full(200, 0.3), site) is None
    assert best_shift_min(minutes[:20], np.full(20, 50_000.0), site) is None


# --- what the clock comparisons of a session say, and the time map that follows from them


def test_stepped_clock_is_found_and_a_time_map_proposed_and_applied(tmp_path):
    anchor = START_NS + 123
    month_ns = 27 * 86_400_000_000_000
    checks = [
        ClockCheck(0, anchor, 50),
        ClockCheck(3_000_000_000, anchor, 50),
        ClockCheck(4_000_000_000, anchor + month_ns, 50),
    ]
    path = recorded(tmp_path / "a.h5", STEADY, entries=checks)
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
    return recorded(path, [n * SECOND_NS for n in range(200)], entries=checks)


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
    return recorded(path, STEADY, entries=checks)


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
    path = recorded(tmp_path / "a.h5", [0, SECOND_NS, 7260 * SECOND_NS], entries=checks)
    assert "2 h 00 min" in said(path, "clock", "ok")
