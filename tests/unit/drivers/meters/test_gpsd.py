import json
import socket
import threading

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.gpsd import WATCH, Gpsd, parse
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceLostError, DeviceNotFoundError
from fieldkit.model.samples import NO_COUNTER
from tests.harness.next_steps import at


def line(kind, **report):
    return json.dumps({"class": kind, **report}).encode() + b"\n"


TPV = line("TPV", mode=3, time="2026-11-21T02:15:30.000Z", lat=35.689447, lon=139.75502, alt=38.4)
PPS = line("PPS", real_sec=100, real_nsec=0, clock_sec=100, clock_nsec=250_000_000)


@pytest.fixture
def daemon():
    """A server that says what gpsd would, once it is asked to watch."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve():
        connection, _ = server.accept()
        with connection:
            assert connection.recv(256) == WATCH
            connection.sendall(line("VERSION", release="3.25") + TPV + PPS)

    thread = threading.Thread(target=serve)
    thread.start()
    yield f"127.0.0.1:{server.getsockname()[1]}"
    thread.join(5)
    server.close()


def test_position_and_clock_error_are_recorded_until_it_hangs_up(daemon):
    device = Gpsd().open(DeviceSettings("gps", "gpsd", port=daemon), HostClock())
    place = device.read(1.0)
    assert place.values[:3] == (35.689447, 139.75502, 38.4)
    assert place.device_time == 1_795_227_330_000_000_000
    assert device.read(1.0).values[3] == pytest.approx(0.25)
    with pytest.raises(DeviceLostError, match="hung up"):
        device.read(1.0)
    device.close()


def test_fewer_names_than_channels_leave_the_others_out(daemon):
    labels = {"labels": ["latitude", "longitude"]}
    device = Gpsd().open(DeviceSettings("gps", "gpsd", port=daemon, options=labels), HostClock())
    assert device.info.shape == (2,)
    assert device.read(1.0).values == (35.689447, 139.75502)
    device.close()


def test_a_report_with_every_field_has_room_in_the_recording(daemon):
    """Fields of gpsd_json(5), from a receiver by the name that udev links."""
    names = (
        "altHAE altMSL alt epx epy epv epd eps epc eph sep track magtrack magvar speed climb ecefx ecefy "
        "ecefz ecefvx ecefvy ecefvz ecefpAcc ecefvAcc velN velE velD geoidSep relN relE relD dgpsAge "
        "dgpsSta baseS clockbias clockdrift jam temp"
    )
    device = "/dev/serial/by-id/usb-u-blox_AG_-_www.u-blox.com_u-blox_GNSS_receiver-if00"
    fields = {"class": "TPV", "device": device, "mode": 3, "time": "2026-11-21T02:15:30.000Z"}
    fields |= {"lat": -35.689447123, "lon": -179.755020123, **dict.fromkeys(names.split(), -3961234.1234)}
    reading = json.dumps(fields, separators=(",", ":")).encode()
    meter = Gpsd().open(DeviceSettings("gps", "gpsd", port=daemon), HostClock())
    assert 1024 < len(reading) <= meter.info.raw_bytes
    meter.close()


def test_no_gpsd_says_how_to_start_it():
    with pytest.raises(DeviceNotFoundError, match="systemctl", check=at("127.0.0.1:1")):
        Gpsd().open(DeviceSettings("gps", "gpsd", port="127.0.0.1:1"), HostClock())


@pytest.mark.parametrize(
    "time", ["2016-12-31T23:59:60.000Z", "9999-12-31T23:59:59Z", "2026-11-21T02:15:30", 1479695730.0, None]
)
def test_position_with_a_time_that_cannot_be_held_is_still_one(time):
    record = parse(line("TPV", mode=2, time=time, lat=46.5, lon=7.5))
    assert (record.values[0].value, record.device_time) == (46.5, NO_COUNTER)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"{\n", "not a gpsd report"),
        *((text, "not an object") for text in (b"[]\n", b"17\n")),
        (b'{"class":"PPS"}\n', "'clock_sec' is missing"),
        (b'{"class":"PPS","real_sec":1,"real_nsec":0,"clock_sec":1,"clock_nsec":1e999}\n', "not a number"),
        (b'{"class":"TPV","mode":3,"lat":"x"}\n', "not a gpsd report"),
        (b'{"class":"TPV","mode":3,"lat":95.0,"lon":7.0}\n', "not on the Earth"),
    ],
)
def test_what_is_no_report_is_rejected(text, reason):
    rejected = parse(text)
    assert isinstance(rejected, Rejected)
    assert reason in rejected.reason
