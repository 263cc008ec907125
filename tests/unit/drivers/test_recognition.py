"""What sends or replies on a port is recognised: output of real boards and meters, at their speeds."""

import os
import struct
import termios
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from fieldkit.drivers.meters.modbus import pack_request
from fieldkit.drivers.ports import Line, SerialPort
from fieldkit.drivers.recognition import recognise
from fieldkit.model.clock import HostClock
from fieldkit.model.errors import DeviceAccessError
from tests.harness.network import NetworkAdapter
from tests.harness.next_steps import at
from tests.unit.drivers.conftest import Wire

LUX = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
K204 = bytes.fromhex("02 80 06 00 00 00 00 00 EF" + 30 * "00" + "0E 00 00 00 00 03")
T10 = bytes.fromhex("02 30 30 35 34 20 20 20 20 03 30 32 0D 0A")
PCE = bytes.fromhex("AA DD 00 26 06 11 21 10 15 30 09 57 09 57 80 00 00 00")
RTD = bytes.fromhex("01 03 10 00 FA 00 FD FF CC 03 ED 00 00 00 01 00 F9 7F FF B5 3A")
SMP = bytes.fromhex("01 04 10 00 01 00 00 00 00 03 E5 03 E5 00 00 00 F8 00 EA 66 12")
PIXELS = struct.pack("<HH769h", 0x5A5A, 0x0602, *[2350] * 768, 2400)
MLX = PIXELS + struct.pack("<H", sum(struct.unpack("<771H", PIXELS)) & 0xFFFF)
ESP32 = (
    b"rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST)\r\nmode:DIO, clock div:1\r\nload:0x3fff0030,len:1184\r\n"
)
BH1750 = b"Light: 54.17 lx\r\n"
TALKING = {  # baud, what comes once, what comes every half second, proposal, a value that was read
    "lutron": (9600, b"\x34\x02", LUX, "lutron", "98760 lx"),
    "gps": (9600, b"0,E,2*6B\r\n", b"$GPZDA,021530.00,21,11,2026,00,00*66\r\n", "nmea", "utc"),
    "old gps": (4800, b"", b"$GPZDA,021530.00,21,11,2026,00,00*66\r\n", "nmea,baud=4800", "utc"),
    "mlx90640": (115_200, b"\x5a\x5a", MLX, "mlx90640", "296.65 K"),
    "bh1750": (9600, b"54.17 lx\r\n", BH1750, "text,sensor=bh1750", "lux = 54.17 lx"),
    "bh1750 of another speed": (57_600, b"", BH1750, "text,sensor=bh1750,baud=57600", "lux = 54.17 lx"),
    "max31856": (
        115_200,
        b"MAX31856 thermocouple test\r\nThermocouple type: K Type\r\n",
        b"Cold Junction Temp: 23.44\r\nThermocouple Temp: 24.12\r\n",
        "text,sensor=max31856",
        "T1 = 24.12 °C",
    ),
    "two probes": (
        9600,
        b"Dallas Temperature IC Control Library Demo\r\nLocating devices...Found 2 devices.\r\n",
        b"Device Address: 281D3931020000F0 Temp C: 21.50 Temp F: 70.70\r\n"
        b"Device Address: 281D3931020000F1 Error: Could not read temperature data\r\n"
        b"Requesting temperatures...DONE\r\n",
        "text,sensor=ds18b20-multiple",
        "281D3931020000F0 = 21.5 °C",
    ),
    "a board's own lines": (115_200, ESP32, b"T1=21.5 C, T2=22.5 C\r\n", "text", "T1 = 21.5 °C"),
    "disconnected": (9600, b"", b"T1=-127.00 C\r\n", "text,baud=9600", "(impossible)"),
    "rows of an image": (
        115_200,
        b"",
        b"\r\n".join([b", ".join(16 * [b"23.50"])] * 12) + b"\r\n\r\nRead time: 250\r\n",
        "mlx90640",
        "mean = 296.65 K",
    ),
    "out of range": (9600, b"", b"Ambient 24.1 C, Object -7999 C\r\n", "text,baud=9600", "(impossible)"),
}
UNREAD = {  # what no driver reads, and what proposes nothing
    "noise": (9600, b"", bytes(range(128, 256)) * 3),
    "words": (115_200, b"", b"LUX 980.2\r\nready\r\n"),
}
REPLYING = {
    "center": ({b"A": K204, b"K": b"309\r"}, "center-309", True),
    "t-10": ({bytes.fromhex("02 30 30 35 34 31 20 20 20 03 31 33 0D 0A"): T10}, "konica-minolta", True),
    "pce": ({bytes.fromhex("87 83 11"): PCE}, "pce-174", True),
    "rtd": ({pack_request(1, 3, 0, 8): RTD}, "modbus,map=rtd-8", False),
    "echo": ({pack_request(1, 4, 2, 8): pack_request(1, 4, 2, 8) + SMP}, "modbus,map=kipp-smp", False),
}


class Board(Wire):
    """Prints at its own speed: at another one of the port its bytes come garbled."""

    def prints(self, baud, once, every):
        self.once = once
        self._start(self._print, (baud, every))

    def _print(self, line):
        baud, every = line
        try:
            while self.far >= 0:
                data, self.once = self.once + every, b""
                is_right = termios.tcgetattr(self.near)[5] == getattr(termios, f"B{baud}")
                os.write(self.far, data if is_right else bytes(byte ^ 0xB7 for byte in data))
                time.sleep(0.5)
        except (OSError, termios.error):
            return


@pytest.fixture
def board(tmp_path):
    wires = []

    def plug():
        wires.append(Board(tmp_path / str(len(wires))))
        return wires[-1]

    yield plug
    for wire in wires:
        wire.cut()
        for thread in wire.threads:
            thread.join(2)


def recognised(wires):
    """Of many ports at once: each waits for seconds."""
    with ThreadPoolExecutor(len(wires)) as threads:
        return list(threads.map(lambda wire: recognise(wire.path, HostClock()), wires))


def test_what_a_port_sends_is_recognised_at_its_speed(board):
    wires = [board() for _ in TALKING]
    for wire, (baud, once, every, *_) in zip(wires, TALKING.values(), strict=True):
        wire.prints(baud, once, every)
    for (*_, proposal, value), found in zip(TALKING.values(), recognised(wires), strict=True):
        assert [(str(match), match.is_certain) for match in found.matches] == [(proposal, True)], found
        (match,) = found.matches
        assert value in match.shown


def test_what_no_driver_reads_is_shown_and_silence_too(board):
    wires = [board() for _ in UNREAD]
    for wire, (baud, once, every) in zip(wires, UNREAD.values(), strict=True):
        wire.prints(baud, once, every)
    noise, words, silence = recognised([*wires, board()])
    assert [list(found.matches) for found in (noise, words, silence)] == [[], [], []]
    assert (b"LUX 980.2" in words.received, bool(noise.received), silence.received) == (True, True, b"")


def test_what_only_replies_is_asked_and_registers_alone_prove_nothing(board):
    wires = [board() for _ in REPLYING]
    for wire, (replies, *_) in zip(wires, REPLYING.values(), strict=True):
        wire.reply(replies)
    for (_, label, is_certain), found in zip(REPLYING.values(), recognised(wires), strict=True):
        assert [(str(match), match.is_certain) for match in found.matches] == [(label, is_certain)]


def test_an_adapter_in_the_network_is_recognised_in_one_connection():
    head = bytes.fromhex("00 01 00 00 00")
    request = head + bytes.fromhex("06 02 03 00 00 00 08")
    reply = head + b"\x13\x02" + RTD[1:-2]
    for far, label in (
        (NetworkAdapter(talk=LUX), "lutron"),
        (NetworkAdapter(replies={request: reply}), "modbus,framing=tcp,map=rtd-8,unit=2"),
    ):
        found = recognise(far.port, HostClock())
        far.unplug()
        (match,) = found.matches
        assert sorted(str(match).split(",")) == sorted(label.split(","))


def test_a_port_that_another_program_holds_is_an_error(wire):
    held = SerialPort(wire.path, Line(9600), HostClock())
    with pytest.raises(DeviceAccessError, check=at(wire.path)):
        recognise(wire.path, HostClock())
    held.close()
