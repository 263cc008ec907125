"""Messages, packets and scale: Heimann Sensor, "UDP Transfer protocol WiFi Shield Rev1", 2024-01-22."""

import socket
import threading

import numpy as np
import pytest

from fieldkit.drivers.cameras.htpa import AMBIENT, FIRST, Htpa, decode
from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceAccessError, DeviceError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.samples import Quality
from tests.harness.conformance import conforms
from tests.harness.next_steps import at

ANSWER = (
    "HTPA series responsed! I am Arraytype {} MODTYPE 011\r\nADC: 16\r\n"
    "HTPAxxxxxd v.2.20 Heimann Sensor GmbH; written by D. Pauer 2021-01-13\r\nI am running on 5000.0 kHz\r\n"
    "MAC-ID: 24.6F.28.AA.BB.CC IP: 192.168.004.001 DevID: 0000012345"
)


def frame(kelvin_10=2950):
    """Pixel n is `kelvin_10` + n/32; ambient 301.5 K."""
    words = np.zeros(1290, "<u2")
    words[:1024] = kelvin_10 + np.arange(1024) // 32
    words[1280:1282] = 34_000, 3015
    return words.tobytes()


def test_pixels_are_tenths_of_kelvin_row_by_row():
    decoded = decode(frame())
    assert decoded.counts.shape == (32, 32)
    assert (decoded.counts[[0, 0, 1, 31], [0, 31, 0, 31]] * decoded.scale).tolist() == pytest.approx(
        [295.0, 295.0, 295.1, 298.1]
    )
    assert decoded.fpa_temperature_k == pytest.approx(301.5)
    assert AMBIENT == 2 * 1281  # behind 1024 pixels, 256 offsets and the supply voltage
    assert decoded.quality == Quality.GOOD


def test_voltages_in_place_of_temperatures_are_no_value():
    assert decode(frame(30_000)).quality & Quality.NO_VALUE
    assert isinstance(decode(frame()[:-2]), Rejected)


class Board:
    """A board on loopback; `sends` are its datagrams after ``K``."""

    def __init__(self, sends=(), array=10, bound=False, computers=1):
        self.sends, self.array, self.bound, self.heard = sends, array, bound, []
        self.computers = computers
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self):
        while self.heard.count(b"x Release HTPA series device") < self.computers:
            heard, computer = self.socket.recvfrom(256)
            self.heard.append(heard)
            if heard == b"Calling HTPA series devices":
                self.socket.sendto(ANSWER.format(self.array).encode(), computer)
                self.socket.sendto(b"calibration 1.0", computer)
            elif heard == b"Bind HTPA series device":
                refusal = b"Device already bound\n\r"
                self.socket.sendto(refusal if self.bound else b"HW Filter is 127.000.000.001 MAC", computer)
            elif heard == b"K":
                for one in self.sends:
                    self.socket.sendto(one, computer)
        self.socket.close()


def opened(board):
    return open_with(Htpa(), DeviceSettings("ir", "htpa", port=board.port), HostClock())


def test_a_board_is_bound_read_and_released_and_a_lost_packet_is_counted():
    one, two, three = frame(2950), frame(2960), frame(2970)
    whole = [part for one in (one, two, three) for part in (one[:FIRST], one[FIRST:])]
    # second half of two, first of one lost
    board = Board([whole[place] for place in (0, 1, 2, 4, 5, 1, 2, 3)])
    device = opened(board)
    info = device.info
    assert (info.unit, info.shape, info.scale, info.serial_number) == ("K", (32, 32), 0.1, "0000012345")
    assert (info.model, info.firmware) == ("HTPA32x32d", "2.20")
    frames = [device.read(1.0) for _ in range(4)]
    assert [one and int(one.counts[0, 0]) for one in frames] == [None, 2970, None, 2960]
    assert device.rejected == 2
    device.close()
    board.thread.join(5)
    assert board.heard == [
        b"Calling HTPA series devices",
        b"Bind HTPA series device",
        b"K",
        b"x Release HTPA series device",
    ]


def test_a_board_conforms_in_the_network():
    whole = [frame(2950 + number) for number in range(20)]
    board = Board([part for one in whole for part in (one[:FIRST], one[FIRST:])], computers=2)
    conforms(Htpa(), DeviceSettings("t", "htpa", port=board.port))
    board.thread.join(5)


def test_a_board_bound_elsewhere_or_of_another_array_is_refused_by_name():
    with pytest.raises(DeviceAccessError, match=r"^127\.0\.0\.1:\d+: "):
        opened(Board(bound=True))
    with pytest.raises(DeviceError, match="HTPA32x32d"):
        opened(Board(array=11))


def test_a_board_that_is_off_is_named_with_its_address():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
        unused.bind(("127.0.0.1", 0))
        port = f"127.0.0.1:{unused.getsockname()[1]}"
    with pytest.raises((DeviceNotFoundError, DeviceLostError), check=at(port)):
        open_with(Htpa(), DeviceSettings("ir", "htpa", port=port), HostClock())
