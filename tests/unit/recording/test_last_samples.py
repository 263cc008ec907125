"""A recording that begins with what the preview before it has shown (``record --include-last``)."""

import os
import pty
import threading
import time
import tty
from contextlib import contextmanager

import numpy as np
import pytest

import fieldkit
from fieldkit.config import load_config
from fieldkit.model.clock import HostClock
from fieldkit.model.samples import EventKind, Frame, Reading
from fieldkit.recording.last_samples import (
    FOLDER,
    KEPT_BYTES,
    KEPT_S,
    LastSamples,
    ask_for_last_samples,
    left_samples,
)
from fieldkit.recording.opening import Instruments
from fieldkit.recording.running import previewing
from fieldkit.results.check import check
from fieldkit.sessions.lock import is_locked
from fieldkit.sessions.reader import open_session
from tests.harness import command_line
from tests.harness.command_line import program
from tests.harness.page import served
from tests.harness.recording import header
from tests.harness.waiting import wait_until

EVERY_S = 0.02


@pytest.fixture
def campaign(tmp_path):
    return fieldkit.init_campaign(tmp_path / "sand", simulated=True)


@pytest.fixture
def counting(tmp_path):
    """A campaign of a board that prints a greater number every 20 ms; and by number when it did, s."""
    far, near = pty.openpty()
    tty.setraw(near)
    printed, done = [], threading.Event()

    def talk():
        while not done.wait(EVERY_S):
            printed.append(time.monotonic())
            os.write(far, b"T=%.2f C\r\n" % ((len(printed) - 1) / 100))

    made = fieldkit.init_campaign(tmp_path / "board")
    with made.config.path.open("a") as file:
        file.write(f'\n[thermometer]\ndriver = "text"\nport = "{os.ttyname(near)}"\n')
    talking = threading.Thread(target=talk)
    talking.start()
    yield made.config.path.parent, printed
    done.set()
    talking.join()
    os.close(far)
    os.close(near)


@contextmanager
def live(folder, *words):
    """``fieldkit live`` in a process of its own, which has the instruments from here on."""
    with program("live", "-C", folder, *words, stdout=None) as process:
        wait_until(lambda: is_locked(folder / "recordings", ".preview") or process.poll(), "no preview")
        yield process


def test_real_samples_keep_their_monotonic_time_and_none_is_lost_or_doubled(counting):
    """What comes from outside: the board's numbers, one every 20 ms of the same computer's counter."""
    folder, printed = counting
    with live(folder) as process:
        seen = len(printed) + 200  # more than are looked for: a busy computer reads them late
        wait_until(lambda: len(printed) > seen, "the board says nothing")
        session = fieldkit.record(folder, duration="2s", include_last="1m")
        assert "fieldkit status" in process.stderr.read()
    assert process.returncode == 0
    assert check(session.path).level != "fail"
    with open_session(session.path) as stored:
        samples = list(stored.samples("thermometer"))
        numbers = np.round([100 * (sample.values[0] - 273.15) for sample in samples]).astype(int)
        times_s = np.array([sample.mono_ns for sample in samples]) / 1e9
        utc_s = np.array([sample.time_ns for sample in samples]) / 1e9
        begun_ns = next(one.mono_ns for one in stored.events() if one.kind is EventKind.START)
        assert stored.start_ns == samples[0].time_ns
    before = times_s < begun_ns / 1e9
    assert before.sum() > 80
    assert (~before).sum() > 3
    assert set(np.diff(numbers[before])) == {1}
    assert set(np.diff(numbers[~before])) == {1}
    assert numbers[~before][0] > numbers[before][-1]
    # of the four seconds before, not of the moment at which they were handed over
    assert np.median(times_s[before] - np.array(printed)[numbers[before]]) == pytest.approx(0.0, abs=1.0)
    assert np.ptp(utc_s - times_s) < 1e-5  # one anchor; the file has microseconds


def test_the_page_starts_with_what_it_has_shown(campaign):
    folder = campaign.config.path.parent
    settings = {"preview": True, "simulation__speed": 20, "record__sampling": "all"}
    with served(folder, **settings) as page, page.browser() as browser:
        browser.next("state", phase="preview")
        first_ms = browser.next("now")["time_ms"]
        wait_until(lambda: browser.next("now")["time_ms"] > first_ms + 50_000, "the preview stands still")
        answer = browser.request(do="start", name="late", include_last="40s", duration="10m")
        assert answer["ok"], answer
        browser.next("now")
        assert browser.request(do="stop", confirm=True)["ok"]
        browser.next("state", phase="preview")
    assert not (folder / "recordings" / FOLDER).exists()
    (path,) = (folder / "recordings").glob("*-late.h5")
    assert check(path).level != "fail"
    with open_session(path) as stored:
        start, included = [one for one in stored.events() if one.kind is EventKind.START]
        begun_ns = start.time_ns
        count = sum(one.time_ns < begun_ns for one in stored.samples())
        times_s = [one.time_ns / 1e9 for one in stored.samples("camera") if one.time_ns < begun_ns]
        minutes = {minute.time_ns for minute in stored.minutes(recorded=True)}
    assert included.text.split()[0] == f"{count}"
    assert 35 < np.ptp(times_s) < 41
    assert np.diff(times_s).max() < 1.5 / 8.7  # of the camera's data sheet: 8.7 Hz
    assert min(minutes) < begun_ns


def test_without_a_preview_the_recording_begins_now_and_says_so(campaign):
    notes = []
    settings = {"duration": "5s", "include_last": "2m", "notify": notes.append}
    session = fieldkit.record(
        load_config(campaign.config.path, settings=["simulation.speed=max"]), **settings
    )
    assert len(notes) == 1
    assert session.count("lux") > 3


def test_a_recording_that_is_to_wait_begins_earlier_instead(campaign):
    folder = campaign.config.path.parent
    done = command_line.fieldkit("record", "-C", folder, "--at", "12:30", "--include-last", "2m")
    assert done.exit_code == 2
    assert "--at" in done.stderr


def test_a_preview_is_refused_while_another_has_the_instruments(campaign):
    folder = campaign.config.path.parent
    with previewing(campaign.config.recordings):
        done = command_line.fieldkit("live", "-C", folder, "--for", "1s")
    assert done.exit_code == 9
    assert f"{os.getpid()}" in done.stderr


# --- what is kept and handed over


@pytest.fixture
def instruments():
    """Streams of a camera and two meters, by this computer's clock; nothing is read from them here."""
    return Instruments(tuple(map(Declared, header().streams)), HostClock(), None, lambda: 0)


class Declared:
    """A device of which only the declaration matters."""

    def __init__(self, info):
        self.info = info


def lux(mono_ns, value=5.0):
    return Reading("lux", mono_ns, 0, (value,), b"raw")


def frame(mono_ns, counts):
    return Frame("camera", mono_ns, 0, counts, np.zeros((2, 160), np.uint16))


def keep(campaign, instruments, *samples):
    """Samples that a preview has shown when a recorder asks for them."""
    kept = LastSamples(campaign.config, instruments)
    for sample in samples:
        kept.show(sample)
    ask_for_last_samples(campaign.config.recordings)
    kept.close()


def test_only_so_many_minutes_are_kept_and_so_many_bytes(campaign, instruments):
    now_ns = instruments.clock.mono_ns()
    ages_s = (2 * KEPT_S, KEPT_S + 1, KEPT_S - 1, 1, 0)
    readings = [lux(now_ns - round(age_s * 1e9), age_s) for age_s in ages_s]
    large = np.zeros((120, 160), np.uint16)
    frames = (frame(now_ns + number, large) for number in range(KEPT_BYTES // large.nbytes + 10))
    keep(campaign, instruments, *readings, *frames)
    with left_samples(campaign.config.recordings) as left:
        included = left.include(instruments, KEPT_S, pytest.fail)
        counts = [sample.stream for sample in included.samples]
    assert 0.99 * KEPT_BYTES < counts.count("camera") * large.nbytes <= KEPT_BYTES
    assert counts.count("lux") == 0  # older than the frames that are left


def test_samples_are_handed_over_as_they_came_without_those_before(campaign, instruments):
    now_ns = instruments.clock.mono_ns()
    counts = np.arange(120 * 160, dtype=np.uint16).reshape(120, 160)
    samples = (lux(now_ns - 120 * 10**9), lux(now_ns - 50 * 10**9, 0.1), frame(now_ns - 5, counts))
    keep(campaign, instruments, *samples)
    with left_samples(campaign.config.recordings) as left:
        reading, picture = left.include(instruments, 60, pytest.fail).samples
    assert (reading.values, reading.raw, reading.mono_ns) == ((0.1,), b"raw", now_ns - 50 * 10**9)
    assert reading.time_ns == instruments.clock.to_utc_ns(reading.mono_ns)
    assert np.array_equal(picture.counts, counts)
    assert not (campaign.config.recordings / FOLDER).exists()


def test_a_stream_that_is_another_one_now_is_left_out_and_named(campaign, instruments):
    now_ns = instruments.clock.mono_ns()
    thermometer = Reading("thermometer", now_ns, 0, (1.0, 2.0, 3.0, 4.0), b"")
    keep(campaign, instruments, lux(now_ns), thermometer)
    camera, _, thermometer = header(rows=0).streams
    now, notes = Instruments((Declared(camera), Declared(thermometer)), instruments.clock, None, int), []
    with left_samples(campaign.config.recordings) as left:
        assert [one.stream for one in left.include(now, 60, notes.append).samples] == ["thermometer"]
    assert [note.partition(":")[0] for note in notes] == ["camera", "lux"]


def test_nothing_is_written_where_nobody_asked_and_nothing_of_an_earlier_recorder_is_read(
    campaign, instruments
):
    kept, recordings = LastSamples(campaign.config, instruments), campaign.config.recordings
    kept.show(lux(instruments.clock.mono_ns()))
    kept.close()
    assert not (recordings / FOLDER).exists()
    ask_for_last_samples(recordings)
    kept.close()  # and the recorder that asked is killed
    ask_for_last_samples(recordings)
    with left_samples(recordings) as left:
        assert left is None
    assert not (recordings / FOLDER).exists()


def test_what_is_left_and_cannot_be_read_does_not_end_the_recording(campaign, instruments, caplog):
    now_ns = instruments.clock.mono_ns()
    keep(campaign, instruments, lux(now_ns - 2), lux(now_ns - 1))
    with left_samples(campaign.config.recordings) as left:
        samples = left.include(instruments, 60, pytest.fail).samples
        assert next(samples).mono_ns == now_ns - 2
        left.journal.close()  # as a disk that is gone
        assert list(samples) == []
    assert [record.levelname for record in caplog.records] == ["WARNING"]


def test_a_preview_that_cannot_write_ends_as_ever(campaign, instruments, caplog):
    kept = LastSamples(campaign.config, instruments)
    kept.show(lux(instruments.clock.mono_ns()))
    ask_for_last_samples(campaign.config.recordings)
    (campaign.config.recordings / FOLDER / "kept.log").mkdir()  # in the way
    kept.close()
    assert [record.levelname for record in caplog.records] == ["WARNING"]
