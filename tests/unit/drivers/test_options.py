"""Options of the configuration: numbers that no instrument has are errors that name the option."""

import math
from typing import Any

import pytest

from fieldkit.drivers import options, registry
from fieldkit.drivers.connections import address_of
from fieldkit.drivers.meters.modbus import load_map
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceNotFoundError
from tests.harness.next_steps import at

NO_NUMBERS = ["9600", True, None, [1], math.nan, math.inf, -math.inf, 10**400]


def settings(driver: str = "nmea", port: str = "", **given: Any) -> DeviceSettings:
    return DeviceSettings("meter", driver, port=port, options=given)


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_finite_number_is_refused_by_the_name_of_its_option(value):
    with pytest.raises(ConfigError, match="accuracy = ", check=at("meter")):
        options.number(settings(accuracy=value), "accuracy", math.nan)


def test_an_option_that_is_not_given_keeps_its_default():
    assert math.isnan(options.number(settings(), "accuracy", math.nan, options.POSITIVE))
    assert options.whole(settings(), "head", 0, (1, 29)) == 0


def test_a_time_or_an_uncertainty_is_not_negative():
    with pytest.raises(ConfigError, match="of at least 0"):
        options.number(settings(latency_s=-1.0), "latency_s", 0.0, options.POSITIVE)


@pytest.mark.parametrize("value", [0, -9600, 49, 4_000_001, 9600.5, *NO_NUMBERS])
@pytest.mark.parametrize("driver", ["nmea", "text", "mlx90640", "modbus"])
def test_a_baud_rate_that_no_line_has_is_an_error_of_the_option(driver, value, wire):
    given = {"baud": value, **({"map": "rtd-8"} if driver == "modbus" else {})}
    with pytest.raises(ConfigError, match="meter: baud = "):
        registry.open_device(settings(driver, wire.path, **given), HostClock())


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("baud = 0", "baud 0 is not"),
        ('baud = "9600"', r"line.baud: "),
        ('parity = "even"', "parity 'even'"),
        ("bits = 9", "bits 9"),
        ("stop = 0", "stop 0"),
    ],
)
def test_a_line_of_a_register_map_is_one_that_exists(line, said, tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(
        f'title = "x"\nquantity = "temperature"\nunit = "°C"\nline = {{ {line} }}\nfunction = 3\nfirst = 0\n'
        'count = 1\n[[channel]]\nname = "T1"\nregister = 0\nunit = "°C"\n'
    )
    with pytest.raises(ConfigError, match=said):
        load_map(str(path))


@pytest.mark.parametrize("head", [-1, 30, 1.5])
def test_a_receptor_head_has_two_digits_up_to_29(head, wire):
    with pytest.raises(ConfigError, match="meter: head = "):
        registry.open_device(settings("konica-minolta", wire.path, head=head), HostClock())


def test_two_channels_do_not_share_a_name():
    with pytest.raises(ConfigError, match="different names"):
        options.labels(settings(labels=["bed", "bed"]), ("T1", "T2"))


@pytest.mark.parametrize("port", ["host:5O01", "host:65536", "host:0", "host:", "host:-1", "host:\u00b2"])
def test_a_port_number_that_is_none_is_not_replaced_by_the_usual_one(port):
    with pytest.raises(ConfigError, match="1 to 65535") as caught:
        address_of(settings("tcam", port), 5001)
    assert 'port = "host:5001"' in caught.value.fix


@pytest.mark.parametrize("driver", ["tcam", "gpsd", "htpa"])
def test_a_name_that_no_host_can_have_is_an_instrument_not_found(driver):
    label = 64 * "x"  # a label of a name has at most 63 octets, RFC 1035, 2.3.4
    with pytest.raises(DeviceNotFoundError, match=label) as caught:
        registry.open_device(settings(driver, f"{label}.local"), HostClock())
    assert caught.value.fix
