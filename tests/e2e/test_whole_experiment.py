"""The main job as a user does it: record on simulated devices, then read the same session again."""

import errno
import os
from contextlib import ExitStack, suppress
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

from fieldkit.config import load_config
from fieldkit.drivers.meters.meter import Meter
from fieldkit.model.alarm import phase_of
from fieldkit.model.errors import StorageError
from fieldkit.model.learnt import Learnt
from fieldkit.model.marks import Mark
from fieldkit.model.next_step import Action
from fieldkit.model.samples import EventKind, Quality, Reading, Severity
from fieldkit.model.slope import SLOPE_FIELDS, SlopeEstimate
from fieldkit.recorder import Summary, View
from fieldkit.recording.opening import open_instruments
from fieldkit.recording.record import PreparedRecording
from fieldkit.recording.requests import inbox, send
from fieldkit.results.estimate import estimate
from fieldkit.results.sources import config_for
from fieldkit.sessions.lock import journal_path
from fieldkit.sessions.reader import open_session
from tests.harness.command_line import document, succeed
from tests.harness.disk import full_disk, small_disk
from tests.harness.next_steps import steps
from tests.harness.replayed_minutes import replayed_minutes


@pytest.fixture(scope="module")
def session_file(recorded, tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("sandslope"))


@pytest.fixture(scope="module")
def campaign(session_file):
    return session_file.parents[1]


def test_live_and_batch_give_the_same_slopes_each_minute(session_file):
    with open_session(session_file) as session:
        live = session.estimates()
        minutes = replayed_minutes(session, config_for(session))
        learnt = [values_of(learnt) for learnt in session.learnt().values()]
    replayed = [bed for minute in minutes for bed in minute.estimates]
    assert {bed.region for bed in live} == {"b05", "b15", "b25"}
    assert all(bed.model.startswith("learned") for bed in live)
    for batch in (replayed, list(estimate(session_file))):
        for key in (minute_of, attrgetter("region"), attrgetter("state"), attrgetter("model")):
            assert list(map(key, batch)) == list(map(key, live))
        for name in SLOPE_FIELDS:
            expected = [getattr(bed, name) for bed in live]
            np.testing.assert_allclose([getattr(bed, name) for bed in batch], expected, rtol=0, atol=1e-9)
    assert np.isfinite([bed.tilt_deg for bed in live]).sum() >= 3 * 6
    assert learnt
    for one, other in zip(
        [values_of(minute.learnt) for minute in minutes if minute.learnt], learnt, strict=True
    ):
        assert one == pytest.approx(other, rel=1e-9)


def minute_of(bed: SlopeEstimate) -> int:
    return bed.time_ns // 1000


def values_of(learnt: Learnt) -> list[float]:
    return [parameter.value for parameter in learnt.parameters]


def test_every_stream_is_recorded_at_its_rate_and_stamped_with_the_scene(session_file):
    with open_session(session_file) as session:
        assert session.state == "sealed"
        assert session.count("camera") == 36  # a burst of three each minute
        assert session.count("lux") == pytest.approx(720, abs=5)
        assert session.count("thermometer") == pytest.approx(720, abs=5)
        assert session.start_ns == pytest.approx(1_451_674_800e9, abs=3e9)  # 2016-01-01 12:00 UTC-7
        flags = [sample.quality for sample in session.samples("camera")]
    assert not any(Quality.SHUTTER in flag or Quality.DROPPED_BEFORE in flag for flag in flags)


def test_check_finds_nothing_wrong_with_a_clear_session(session_file):
    (checked,) = document("check", session_file)["sessions"]
    assert [one for one in checked["findings"] if one["level"] != "ok"] == []


@pytest.mark.parametrize(("fault", "kind"), [("cable", EventKind.LOST), ("shutter", EventKind.SHUTTER)])
def test_a_fault_is_survived_named_on_screen_and_in_the_file_and_found_by_check(campaign, fault, kind):
    """Of other faults: the tests of alarms."""
    words = ("record", "-C", campaign, "--for", "8m", "--name", fault)
    fast = ("--set", "simulation.speed=max", "--set", "estimator.model=full")
    done = succeed(*words, *fast, "--set", f'simulation.faults=["{fault}"]')
    path = next(campaign.glob(f"recordings/*-{fault}.h5"))
    with open_session(path) as session:
        events = [event for event in session.events() if event.kind is kind]
        readings = session.count("lux")
        assert session.state == "sealed"
    assert events
    assert any(event.text in done.stderr for event in events)
    assert readings == pytest.approx(60 * 8, abs=5)
    findings = succeed("check", path)
    assert fault in findings.stdout.lower() or events[0].text in findings.stdout


class Falling:
    """Looks on, and falls over at an item, or when all is over."""

    def __init__(self, at: int = 0) -> None:
        self.seen, self.at = 0, at

    def show(self, item: object) -> None:
        self.seen += 1
        if self.seen == self.at:
            raise KeyError("falling")

    def close(self) -> None:
        raise ValueError("a mistake at the end")


def record(campaign: Path, path: Path, seconds: float, *views: View, setting: str = "") -> Summary:
    settings = ["simulation.speed=max", *filter(None, [setting])]
    config = load_config(campaign / "fieldkit.toml", settings=settings)
    with open_instruments(config, duration_s=seconds) as tools:
        return PreparedRecording(config, tools, path, duration_s=seconds).run(views).summary


def test_views_that_raise_do_not_end_the_recording(campaign):
    path = campaign / "recordings" / "views.h5"
    views = [Falling(at=20), Falling()]
    summary = record(campaign, path, 59.0, *views)
    with open_session(path) as session:
        assert session.state == "sealed"
        assert session.count("lux") == summary.counts["lux"] == pytest.approx(59, abs=3)
        (event,) = [event for event in session.events() if event.kind is EventKind.VIEW]
    assert event.severity is Severity.WARNING
    assert "KeyError('falling')" in event.text
    assert views[0].seen == 20
    assert views[1].seen > 120  # two meters each second, and pictures


class Filling:
    """Looks on; from one reading of the light meter to another no more than `room` bytes fit the journal."""

    def __init__(self, session: Path, first: int, last: int = -1, room: int = 0) -> None:
        self.session, self.first, self.last, self.room = session, first, last, room
        self.disk = ExitStack()

    def show(self, item: object) -> None:
        if not isinstance(item, Reading) or item.stream != "lux":
            return
        if item.seq == self.first:
            send(inbox(self.session), Mark("the last"))
            self.fill()
        elif item.seq == self.last:
            self.disk.close()

    def fill(self) -> None:
        part = max(journal_path(self.session).glob("0*.log"))
        self.disk.enter_context(full_disk(part.stat().st_size + self.room))

    def close(self) -> None:
        self.disk.close()


def test_pictures_left_out_just_before_the_end_are_told(campaign):
    """A second without room for frames 4 s before the end: the pause that follows outlives the recording."""
    path = campaign / "recordings" / "paused.h5"
    record(campaign, path, 30.0, Filling(path, 25, 26, room=10_000), setting="record.sampling=all")
    with open_session(path) as session:
        (told,) = [event.text for event in session.events() if event.kind is EventKind.DISK]
        pictures = session.count("camera")
        assert session.count("lux") == pytest.approx(30, abs=3)
    left_out = int(told.split()[0])
    assert told.startswith(f"{left_out} frames skipped after a storage error: ")
    assert os.strerror(errno.EFBIG) in told
    assert pictures + left_out == pytest.approx(30 * 8.7, abs=10)


class Crowding(Filling):
    """Another program that fills the disk, all at once."""

    def fill(self) -> None:
        with suppress(OSError), (self.session.parent / "crowd").open("wb", buffering=0) as file:
            while file.write(bytes(4096)):
                pass


def test_a_session_that_ended_early_says_so_and_keeps_the_marks_of_its_last_second(campaign, tmp_path):
    """The disk takes next to nothing from second 20 on, until the room kept for the end is given back."""
    with small_disk(tmp_path, "24m") as place:
        path = place / "full.h5"
        summary = record(campaign, path, 600.0, Crowding(path, 20))
        assert summary.failure is not None
        with open_session(path) as session:
            assert session.state == "sealed"
            assert 20 < session.count("lux") == summary.counts["lux"] < 60
            errors = [one for one in session.events() if one.severity is Severity.ERROR]
            marks = [one.text for one in session.events() if one.kind is EventKind.MARK]
    ends = [one.text for one in errors if phase_of(one) is None]
    assert ends[-1].startswith("the recording ended early: ")
    assert os.strerror(errno.ENOSPC) in ends[-1]
    assert marks == ["the last"]


def test_a_mark_that_no_room_is_left_for_is_not_sealed_away(campaign):
    """Recovery keeps it, once there is room."""
    path = campaign / "recordings" / "no-room.h5"
    with pytest.raises(StorageError, match=r"no-room\.h5") as failed:
        record(campaign, path, 20.0, Filling(path, 10))
    assert [step.action for step in steps(failed.value)] == [Action.RECOVER]
    succeed("recover", path)
    with open_session(path) as session:
        assert [one.text for one in session.events() if one.kind is EventKind.MARK] == ["the last"]
        assert session.count("lux") >= 11


@pytest.mark.parametrize(
    ("change", "told"), [({"values": (1.0, 2.0)}, ("(1,)", "(2,)")), ({"device_seq": 2**63}, (" 64 ",))]
)
def test_samples_that_are_not_as_declared_cost_only_themselves(campaign, change, told):
    """As of a driver with a mistake in it: two wrong ones in a row are told once."""
    path = campaign / "recordings" / f"misfit-{next(iter(change))}.h5"
    original, calls = Meter.read, []

    def read(self: Meter, timeout_s: float) -> Reading | None:
        reading = original(self, timeout_s)
        if reading is not None and reading.stream == "lux":
            calls.append(reading)
            if len(calls) in (10, 11):
                return reading._replace(**change)
        return reading

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Meter, "read", read)  # a driver that breaks its declaration: none of ours does
        summary = record(campaign, path, 30.0)
    with open_session(path) as session:
        assert session.state == "sealed"
        assert session.count("lux") == summary.counts["lux"] == len(calls) - 2
        (event,) = [event for event in session.events() if event.kind is EventKind.GARBLED]
    assert "'lux'" in event.text
    assert all(word in event.text for word in told)
