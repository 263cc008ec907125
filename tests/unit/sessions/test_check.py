"""`check` finds each kind of trouble, and only that."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import SessionError
from fieldkit.model.samples import Event, EventKind, Quality, Severity
from fieldkit.model.site import Site
from fieldkit.sessions.check import best_shift_min, check
from fieldkit.sessions.finished_file import apply_time_map
from fieldkit.sessions.reader import open_session
from fieldkit.sessions.writer import SessionWriter
from tests.harness.findings import said
from tests.harness.recording import START_NS, CountedClock, header, sample
from tests.shared_data import shared

HEADER = header((24, 32))
CAMERA, LUX, _ = HEADER.streams
STEP_NS = 111_111_111


def recorded(
    path: Path,
    times_ns: list[int],
    flags: dict[int, Quality] | None = None,
    camera: StreamInfo = CAMERA,
    **more: object,
) -> Path:
    """A session of one camera with frames at these monotonic times, and what `more` says."""
    clock = CountedClock()
    writer = SessionWriter(path, replace(HEADER, streams=(camera, *HEADER.streams[1:])), clock)
    for seq, mono in enumerate(times_ns):
        frame = sample(camera, seq, mono, clock.to_utc_ns(mono))
        writer.append(frame._replace(quality=(flags or {}).get(seq, Quality.GOOD)))
    for event in more.get("events", ()):  # type: ignore[attr-defined]
        writer.put(event)
    writer.close()
    return path


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
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "a.h5", HEADER, clock)
    for seq, mono in enumerate(STEADY):
        frame = sample(CAMERA, seq, mono, clock.to_utc_ns(mono))
        flag = Quality.DROPPED_BEFORE if seq == 31 else Quality.GOOD
        writer.append(frame._replace(device_seq=seq + 2 * (seq > 30), quality=flag))
    writer.close()
    assert "2 samples" in said(tmp_path / "a.h5", "camera")


def test_light_brighter_than_the_sun_is_not_plausible(tmp_path):
    """The brightest sun gives some 130 000 lx."""
    clock = CountedClock()
    writer = SessionWriter(tmp_path / "a.h5", HEADER, clock)
    for seq in range(5):
        reading = sample(LUX, seq, seq * 10**9, clock.to_utc_ns(seq * 10**9))
        writer.append(reading._replace(values=(300_000.0,)))
    writer.close()
    assert "first 300000 lx" in said(tmp_path / "a.h5", "lux")


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
    found = {one.what: one for one in check(recorded(tmp_path / "a.h5", STEADY, events=events))}
    for kind, (_, level) in LEVELS.items():
        one = found[f"{kind.name.lower()} lux"]
        assert (one.level, f"{kind.name} 0, and 2 more" in one.text) == (level, True), kind


def test_changed_byte_of_a_picture_is_found(tmp_path):
    path = recorded(tmp_path / "a.h5", STEADY)
    with h5py.File(path) as file:
        place = file["camera/counts"].id.get_chunk_info(2).byte_offset
    data = bytearray(path.read_bytes())
    data[place + 40] ^= 0x10
    path.write_bytes(data)
    assert "first number 18" in said(path, "camera", "fail")
    with open_session(path) as session:
        bad = [frame.seq for frame in session.samples("camera") if frame.quality & Quality.BAD_CRC]
        assert bad == list(range(18, 27))  # the third block, and no other frame


def test_changed_byte_of_a_table_is_found(tmp_path):
    path = recorded(tmp_path / "a.h5", STEADY, events=[Event(EventKind.MARK, 1, START_NS, "here")])
    with h5py.File(path) as file:
        place = file["events/text"].id.get_chunk_info(0).byte_offset
    data = bytearray(path.read_bytes())
    data[place] = ord("H")
    path.write_bytes(data)
    assert said(path, "events/text", "fail")


def test_unfinished_session_gets_no_time_map(tmp_path):
    writer = SessionWriter(tmp_path / "a.h5", HEADER, CountedClock())
    writer.abandon()
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
