"""Drivers of other packages that hang or fail, recorded by `fieldkit record` in real time."""

import json
import re
import threading
import time
from collections import Counter

import pytest
import tomlkit

from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings, StreamInfo
from fieldkit.model.errors import DeviceLostError
from fieldkit.model.samples import EventKind, Quality, Reading
from fieldkit.recording import opening
from fieldkit.recording.campaign import init_campaign
from fieldkit.results.session import open_session
from tests.harness.command_line import fieldkit
from tests.harness.plugins import install

FAILURES = {"exits": SystemExit(3), "interrupts": KeyboardInterrupt(), "generates": GeneratorExit()}
TROUBLES = ("hangs", *FAILURES)
openings = Counter()
released = threading.Event()
"""Ends what hangs."""


class Meter:
    """A meter of 20 Hz; its trouble is a call and what becomes of it, such as "open hangs"."""

    rejected = 0

    def __init__(self, settings, clock):
        self.info = StreamInfo(settings.name, "illuminance", "lx", (1,), rate_hz=20.0)
        self.trouble, self.clock = settings.options["trouble"], clock
        openings[settings.name] += 1
        self.opening = openings[settings.name]
        self.fail("open")
        self.readings = 0

    def fail(self, call):
        if self.trouble == "lost" and (call, self.opening) == ("read", 1):
            raise DeviceLostError("unplugged")
        hangs_once_lost = self.trouble == "lost" and (call, self.opening) in (("close", 1), ("open", 2))
        if hangs_once_lost or self.trouble == f"{call} hangs":
            released.wait(60.0)
        elif str(self.trouble).startswith(call):
            raise FAILURES[self.trouble.split()[1]]

    def read(self, timeout_s):
        time.sleep(0.05)
        self.readings += 1
        if self.readings > 3:
            self.fail("read")
        now = self.clock.mono_ns()
        stamp = self.trouble if isinstance(self.trouble, int | float) else now
        return Reading(self.info.name, stamp, self.clock.to_utc_ns(now), (5.0,))

    def close(self):
        self.fail("close")


class Driver:
    name, title, quantity = "troubled", "Troubled meter", "illuminance"

    def find(self):
        return []

    open = staticmethod(Meter)


@pytest.fixture
def record(tmp_path, monkeypatch):
    """`fieldkit record` for 4 s of meters with these troubles."""
    install(tmp_path, "troubled-meter", "troubled", f"{__name__}:Driver")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(opening, "NAMED_AFTER_S", 0.1)
    released.clear()
    openings.clear()

    def command(troubles, *words):
        options = {name: {"options": {"trouble": trouble}} for name, trouble in troubles.items()}
        tables = {
            name: {"driver": "troubled", "connect_timeout_s": 0.4, **options[name]} for name in troubles
        }
        config = init_campaign(tmp_path / "campaign").config
        config.path.write_text(config.path.read_text() + tomlkit.dumps({"device": tables}))
        return fieldkit("record", "-C", config.directory, "--for", "4s", "--json", *words)

    yield command
    released.set()


def test_instruments_whose_drivers_hang_or_fail_as_they_open_are_named(record):
    done = record({trouble: f"open {trouble}" for trouble in TROUBLES})
    assert done.exit_code == 4
    error = json.loads(done.stderr.splitlines()[-1])["error"]
    assert re.findall(r"^  (\w+): ", error, re.MULTILINE) == [*TROUBLES]
    assert "hangs" in done.stderr.splitlines()[0]  # named before it is given up


def test_recording_begins_without_an_instrument_whose_driver_hangs(record):
    counts = json.loads(record({"good": "", "bad": "open hangs"}, "--allow-missing").stdout)["counts"]
    assert counts.keys() == {"good"}
    assert counts["good"] > 0


def test_instrument_is_opened_again_although_its_driver_hung_in_closing_and_opening_it(record):
    document = json.loads(record({"meter": "lost", "good": ""}, "--for", "8s").stdout)
    with open_session(document["session"]) as session:
        (back,) = (event for event in session.events() if event.kind is EventKind.BACK)
        assert back.stream == "meter"
        assert session["meter"].times_ns()[-1] > back.time_ns
    assert openings["meter"] == 3


def test_drivers_that_hang_are_not_called_again_and_again(record):
    settings = DeviceSettings("meter", "troubled", options={"trouble": "open hangs"}, connect_timeout_s=0.1)
    for _ in range(opening.MOST_HANGING + 2):
        with pytest.raises(opening.HangingDriverError):
            opening.open_in_time(settings, HostClock())
    assert openings["meter"] == opening.MOST_HANGING


STAMPS = {"beyond": 2**62, "never": float("nan")}


def test_drivers_that_hang_or_fail_later_cost_their_streams_and_delay_no_end(record):
    lost = {f"read-{trouble}": f"read {trouble}" for trouble in TROUBLES}
    closing = {f"close-{trouble}": f"close {trouble}" for trouble in TROUBLES}
    document = json.loads(record({"good": "", **lost, **closing, **STAMPS}).stdout)
    with open_session(document["session"]) as session:
        events = list(session.events())
        streams = {event.text.split(":")[0] for event in events if event.kind is EventKind.LOST}
        assert streams >= {*lost, "close-hangs"}
        stop = next(event for event in events if event.kind is EventKind.STOP)
        assert stop.mono_ns - events[0].mono_ns < 30e9  # what hangs does so for a minute
        for name in ("good", *closing, *STAMPS):
            times_ns, flags = session[name].times_ns(), session[name].flags()
            assert len(times_ns) > 0
            assert set(flags & Quality.INTERPOLATED) == {Quality.INTERPOLATED if name in STAMPS else 0}
