"""Six boards and meters from the box to a slope: few commands, few answers, no editor, no driver's name.

They stand under the sky of the packaged day and send what their makers' examples print, on pseudo-terminals
and a socket. The clock of the recording runs ten times as fast, so that seven minutes last forty seconds.
"""

import io
import json
import os
import struct
import termios
import time
from glob import glob

import numpy as np
import pytest

from fieldkit.cli import main
from fieldkit.config import load_config
from fieldkit.drivers.identity import UsbIdentity
from fieldkit.model.clock import ClockCheck, HostClock
from fieldkit.sessions.reader import open_session
from fieldkit.simulation.scene import ALAMOSA_NOON_NS, BEDS, sand_slopes
from tests.harness.connected import plugged_in
from tests.harness.network import NetworkAdapter
from tests.unit.drivers.conftest import Wire

SPEED = 10
EVERY_S = 0.1
SCENE = sand_slopes(start_ns=ALAMOSA_NOON_NS)
BEGIN_NS = time.monotonic_ns()
MOST_COMMANDS, MOST_ANSWERS = 6, 10


def utc_ns():
    """Time at the boards."""
    return ALAMOSA_NOON_NS + SPEED * (time.monotonic_ns() - BEGIN_NS)


class FastClock(HostClock):
    """The same time for the recording."""

    is_real = False

    def mono_ns(self):
        return SPEED * time.monotonic_ns()

    def check(self):
        return ClockCheck(self.mono_ns(), ALAMOSA_NOON_NS - SPEED * BEGIN_NS, 0)

    def sleep(self, seconds):
        super().sleep(seconds / SPEED)

    def wait_readable(self, fd, timeout_s):
        return super().wait_readable(fd, timeout_s / SPEED)


def celsius():
    return SCENE.frame(utc_ns(), 0).reshape(24, 5, 32, 5).mean((1, 3)) - 273.15


def mlx90640():
    """A frame of the GY-MCU90640."""
    pixels = np.rint(100 * celsius()).astype(int).ravel().tolist()
    words = struct.pack("<HH769h", 0x5A5A, 0x0602, *pixels, 2500)
    return words + struct.pack("<H", sum(struct.unpack("<771H", words)) & 0xFFFF)


def lutron():
    """A light meter's stream, in tens of lux."""
    return b"\x0241150%09d\r" % round(SCENE.lux_reading(utc_ns()))


def dallas():
    """DallasTemperature's example Multiple."""
    lines = [
        f"Device Address: 281D3931020000F{place} Temp C: {kelvin - 273.15:.2f} Temp F: 70.00"
        for place, kelvin in enumerate(SCENE.probe_readings(utc_ns()))
    ]
    return "\r\n".join([*lines, "Requesting temperatures...DONE", ""]).encode()


def bme280():
    """Adafruit's bme280test."""
    air_c = SCENE.air_reading(utc_ns()) - 273.15
    return f"Temperature = {air_c:.2f} *C\r\nPressure = 776.10 hPa\r\nHumidity = 20.10 %\r\n\r\n".encode()


def max31856():
    """Adafruit's max31856_oneshot."""
    junction_c = SCENE.probe_readings(utc_ns())[0] - 273.15
    return f"Cold Junction Temp: 8.50\r\nThermocouple Temp: {junction_c:.2f}\r\n".encode()


def esphome():
    """The log of a board in the network, by its stream server."""
    box_c = SCENE.air_reading(utc_ns()) - 273.15
    return f"[12:00:00][D][sensor:093]: 'Box': Sending state {box_c:.5f} °C\r\n".encode()


BOARDS = {"M": mlx90640, "L": lutron, "D": dallas, "B": bme280, "X": max31856}


class Board(Wire):
    """Sends what it measures now, again and again."""

    def measure(self, line):
        self._start(self._measure, line)

    def _measure(self, line):
        try:
            while self.far >= 0:
                os.write(self.far, line())
                time.sleep(EVERY_S)
        except (OSError, termios.error):
            return


@pytest.fixture
def boards(tmp_path, monkeypatch):
    """Plugged in; the address of the one in the network."""
    wires, present = [], []
    plugged_in(monkeypatch, serial_ports=present)
    for place, (serial, line) in enumerate(BOARDS.items(), 1):
        wires.append(Board(tmp_path / serial))
        wires[-1].measure(line)
        present.append((wires[-1].path, UsbIdentity(0x1A86, 0x7523, serial, f"1-{place}", "USB Serial")))
    adapter = NetworkAdapter(talk=esphome)
    yield adapter.port
    adapter.unplug()
    for wire in wires:
        wire.cut()
        for thread in wire.threads:
            thread.join(2)


class Keyboard(io.StringIO):
    """A terminal at which every question is answered by Enter."""

    answers = 0

    def isatty(self):
        return True

    def readline(self, size=-1):
        self.answers += 1
        return "\n"


def test_six_boards_from_the_box_to_a_slope(boards, tmp_path, monkeypatch, capsys):
    campaign, keyboard = tmp_path / "hill", Keyboard()
    monkeypatch.setattr("fieldkit.recording.opening.HostClock", FastClock)
    monkeypatch.setattr("sys.stdin", keyboard)
    commands = [
        ("init", str(campaign), "--site", "37.70,-105.92,2317", "--yes"),
        ("devices", "--add", "-C", str(campaign)),
        ("devices", "--add", boards, "-C", str(campaign)),
        ("roi", "suggest", "--accept", "-C", str(campaign)),
        ("record", "--for", "7m", "-q", "-C", str(campaign)),
        ("estimate", str(campaign / "recordings/*.h5"), "--json"),
    ]
    for words in commands:
        typed = [path for word in words for path in (sorted(glob(word)) or [word])]  # as a shell does
        main(typed, standalone_mode=False)
    slopes = json.loads(capsys.readouterr().out)["slopes"]
    assert len(commands) <= MOST_COMMANDS
    assert 0 < keyboard.answers <= MOST_ANSWERS
    devices = {device.name: device for device in load_config(campaign / "fieldkit.toml").devices}
    boards_of_text = dict.fromkeys(("thermometer", "bme280", "max31856", "text"), "text")
    drivers = {name: device.driver for name, device in devices.items()}
    assert drivers == {"camera": "mlx90640", "lux": "lutron", **boards_of_text}
    assert devices["thermometer"].options["sensor"] == "ds18b20-multiple"
    with open_session(next((campaign / "recordings").glob("*.h5"))) as session:
        assert all(session.count(name) > 15 for name in drivers)
    truth = [bed.tilt_deg for bed in BEDS if not bed.is_reference]
    for tilt_deg, slope in zip(truth, sorted(slopes, key=lambda slope: slope["tilt_deg"]), strict=True):
        low, high = slope["tilt_region_deg"]
        assert low <= tilt_deg <= high
        assert slope["tilt_deg"] == pytest.approx(tilt_deg, rel=0.3, abs=2.5)
