import re

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.konica_minolta import KonicaMinolta, check, pack_request, parse
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceError
from fieldkit.model.samples import Quality

LUX = bytes.fromhex(
    "02 30 30 31 30 30 20 35 30 2B 39 38 37 36 35 20 20 20 20 20 20 20 20 20 20 20 20 03 30 39 0D 0A"
)


PC_MODE = bytes.fromhex("02 30 30 35 34 20 20 20 20 03 30 32 0D 0A")


class HurriedClock(HostClock):
    """Does not wait where the meter would need a pause."""

    def sleep(self, seconds):
        pass


def signed(body):
    return b"\x02" + body + check(body) + b"\r\n"


def settings(wire, **options):
    return DeviceSettings("lux", "konica-minolta", port=wire.path, every_s=0.01, options=options)


@pytest.mark.parametrize(
    ("packed", "sent"),
    [
        (pack_request(0, "54", "1"), "02 30 30 35 34 31 20 20 20 03 31 33 0D 0A"),
        (pack_request(0, "10", "0200"), "02 30 30 31 30 30 32 30 30 03 30 30 0D 0A"),
        (pack_request(99, "55", "1  0"), "02 39 39 35 35 31 20 20 30 03 30 32 0D 0A"),
        (pack_request(99, "40", "21"), "02 39 39 34 30 32 31 20 20 03 30 34 0D 0A"),
    ],
)
def test_requests_are_those_of_the_manual(packed, sent):
    assert packed == bytes.fromhex(sent)


def test_t10_is_put_into_pc_mode_and_polled(wire):
    wire.reply({pack_request(0, "54", "1"): PC_MODE, pack_request(0, "10", "0200"): LUX})
    device = wire.open(KonicaMinolta(), settings(wire), HurriedClock())
    assert (device.info.unit, device.info.latency_s, device.info.settings["line"]) == ("lx", 0.25, "9600 7E1")
    reading = device.read(1.0)
    assert (reading.values, reading.quality, reading.raw) == ((98760.0,), Quality.GOOD, LUX)


def test_cl200_is_triggered_before_it_is_asked(wire):
    colour = signed(b"00020 50+98765+03124+03294\x03")
    triggered = {pack_request(0, code, text): PC_MODE for code, text in (("54", "1"), ("40", "10"))}
    wire.reply({**triggered, pack_request(0, "02", "1200"): colour})
    device = wire.open(KonicaMinolta(), settings(wire, model="cl-200"), HurriedClock())
    assert device.read(1.0).values == (98760.0,)


@pytest.mark.parametrize(
    ("refusal", "states"), [(b"4", "it is not held"), (b"1", "its head is off"), (b"3", "its EEPROM fails")]
)
def test_cl200_that_refuses_the_trigger_says_why(wire, refusal, states):
    reply = signed(b"00401" + refusal + b"  \x03")
    wire.reply({pack_request(0, "54", "1"): PC_MODE, pack_request(0, "40", "10"): reply})
    with pytest.raises(DeviceError, match=states):
        KonicaMinolta().open(settings(wire, model="cl-200"), HurriedClock())


def test_unknown_status_is_named():
    assert "'0850'" in parse(signed(b"00100850+98765            \x03")).reason


def test_bytes_of_a_port_opened_without_parity_say_so():
    with_parity = bytes(byte | (byte.bit_count() & 1) << 7 for byte in LUX)
    assert "7E1" in parse(with_parity).reason


def test_lower_case_check_is_accepted_and_a_wrong_one_is_not():
    record = signed(b"0054    \x03")
    assert not isinstance(parse(record.lower()), Rejected)
    wrong = parse(LUX[:-3] + b"8\r\n")
    assert re.findall(r"\d+", wrong.reason) == ["08", "09"]
