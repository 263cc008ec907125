"""Serial drivers at every kind of address, over real pseudo-terminals and sockets."""

import threading
import time
from contextlib import closing

import numpy as np
import pytest

import fieldkit
from fieldkit.config import load_config
from fieldkit.drivers import registry
from fieldkit.drivers.connections import is_address
from fieldkit.drivers.meters.modbus import pack_request
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.samples import EventKind
from fieldkit.sessions.reader import open_session
from tests.harness.conformance import conforms
from tests.harness.esphome import SerialProxy
from tests.harness.network import NetworkAdapter
from tests.harness.next_steps import at

LUX = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
K204 = bytes.fromhex("02 80 06 00 00 00 00 00 EF" + 30 * "00" + "0E 00 00 00 00 03")
RTD = bytes.fromhex("01 03 10 00 FA 00 FD FF CC 03 ED 00 00 00 01 00 F9 7F FF B5 3A")
INSTRUMENTS = {  # what it sends or replies, its options, the first value
    "lutron": ({"talk": LUX}, {}, 98_760.0),
    "center-309": ({"replies": {b"K": b"309\r", b"A": K204}}, {}, 297.05),
    "text": ({"talk": b"T1=21.56 C\r\n"}, {}, 294.71),
    "modbus": ({"replies": {pack_request(1, 3, 0, 8): RTD}}, {"map": "rtd-8"}, 298.15),
}


@pytest.fixture
def adapter():
    """Puts instruments behind an adapter in the network."""
    adapters = []

    def plug(scheme, **instrument):
        adapters.append(NetworkAdapter(scheme, **instrument))
        return adapters[-1]

    yield plug
    for plugged in adapters:
        plugged.unplug()


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial's RFC 2217
@pytest.mark.parametrize(
    ("driver", "address"),
    [  # each address with what sends and with what replies; the others are slow
        pytest.param(driver, address, marks=[pytest.mark.slow] * ((number + place) % 2))
        for number, driver in enumerate(("lutron", "text", "center-309", "modbus"))
        for place, address in enumerate(("/dev", "", "socket://", "rfc2217://"))
    ],
)
def test_a_serial_driver_takes_every_address_and_comes_back_after_it_was_unplugged(
    driver, address, adapter, wire
):
    instrument, options, value = INSTRUMENTS[driver]
    if address == "/dev":
        cable, port = wire, wire.path
        wire.talk(instrument["talk"]) if "talk" in instrument else wire.reply(instrument["replies"])
    else:
        cable = adapter(address, **instrument)
        port = cable.port
    settings = DeviceSettings("meter", driver, port, every_s=0.1, options=options)
    device = registry.open_device(settings, HostClock())
    try:
        assert device.read(2.0).values[0] == pytest.approx(value)
    finally:
        device.close()
    conforms(registry.get(driver), settings, cable)


def test_a_serial_proxy_of_esphome_is_set_to_the_drivers_line_and_read():
    proxy = SerialProxy(LUX)
    device = registry.open_device(DeviceSettings("meter", "lutron", proxy.url), HostClock())
    assert device.read(2.0).values == (98_760.0,)
    assert [(line.baudrate, line.data_size, line.parity) for line in proxy.lines] == [(9600, 8, 0)]
    proxy.unplug()
    with pytest.raises(DeviceLostError):
        [device.read(1.0) for _ in range(5)]
    device.close()


def test_modbus_tcp_has_its_own_frame(adapter):
    """Transaction 1, protocol 0, a length and no CRC: Modbus Messaging on TCP/IP 1.0b, section 3.1.3."""
    head = bytes.fromhex("00 01 00 00 00")
    far = adapter("", replies={head + bytes.fromhex("06 01 03 00 00 00 08"): head + b"\x13" + RTD[:-2]})
    settings = DeviceSettings("module", "modbus", far.port, options={"map": "rtd-8", "framing": "tcp"})
    with closing(registry.open_device(settings, HostClock())) as module:
        assert module.read(2.0).values[:4] == pytest.approx((298.15, 298.45, 267.95, 373.65))
    decoded = registry.decode("modbus", head + b"\x13" + RTD[:-2] + b"junk", {"framing": "tcp"})
    assert [value.value for value in decoded.values[:3]] == [250.0, 253.0, 65_484.0]


@pytest.mark.parametrize("port", ["10.0.0.5:", "telnet://10.0.0.5:23", "socket://10.0.0.5"])
def test_an_address_that_is_none_is_refused_before_anything_is_opened(port):
    assert is_address(port)
    with pytest.raises(ConfigError, check=at("meter.port")) as caught:
        registry.open_device(DeviceSettings("meter", "lutron", port), HostClock())
    assert ":" in str(caught.value.fix)


@pytest.mark.parametrize(
    "path", ["10c4:ea60:A7", "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1.2:1.0-port0", "meter", ""]
)
def test_paths_of_ports_and_identities_are_no_addresses(path):
    assert not is_address(path)


@pytest.mark.parametrize(
    "port", ["127.0.0.1:1", "rfc2217://127.0.0.1:1", "esphome://127.0.0.1:1/?port_name=x&key=a"]
)
def test_where_nothing_answers_it_is_missing_and_no_key_is_shown(port):
    with pytest.raises(DeviceNotFoundError, check=at(port.partition("?")[0])) as caught:
        registry.open_device(DeviceSettings("meter", "lutron", port), HostClock())
    assert "key" not in caught.value.message


GAPS_S = [3.0, pytest.param(60.0, marks=pytest.mark.slow)]


@pytest.mark.parametrize("away_s", GAPS_S)
def test_a_recording_outlives_a_network_that_is_away_and_counts_the_gap(away_s, adapter, tmp_path):
    far = adapter("", talk=b"T1=21.56 C\r\n")
    file = fieldkit.init_campaign(tmp_path / "hill", (37.7, -105.92, 2317.0)).config.path
    with file.open("a") as config:
        config.write(f'\n[thermometer]\ndriver = "text"\nport = "{far.port}"\n')

    def pull() -> None:
        while not list(file.parent.glob("recordings/*")):
            time.sleep(0.1)
        time.sleep(1.5)
        far.unplug()
        time.sleep(away_s)
        far.plug()

    hand = threading.Thread(target=pull)
    hand.start()
    recorded = fieldkit.record(load_config(file), duration=6.0 + 2.0 * away_s)
    hand.join()
    with open_session(recorded.path) as session:
        back_s = [event.data["gap_s"] for event in session.events() if event.kind is EventKind.BACK]
        longest_s = np.diff(session.times_ns("thermometer")).max() / 1e9
    assert away_s - 0.5 < max(back_s) <= longest_s + 0.5 < 2.0 * away_s + 3.0
