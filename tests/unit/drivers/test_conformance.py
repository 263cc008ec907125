"""Every driver passes the suite, the sample plug-in too; a driver that breaks a rule is caught."""

import contextlib
import sys
import tomllib
from pathlib import Path

import pytest

from fieldkit.drivers import conformance, registry
from fieldkit.drivers.conformance import check_driver
from fieldkit.drivers.meters.lutron import Lutron
from fieldkit.drivers.meters.modbus import Modbus
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DeviceLostError
from tests.harness.conformance import conforms
from tests.harness.plugins import install

LUX = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
SAMPLE = Path(__file__).parents[2] / "data/sample_plugin"


def levels(outcomes):
    return [outcome.level for outcome in outcomes]


@pytest.mark.parametrize("name", registry.BUILT_IN)
def test_every_driver_of_ours_conforms(name):
    outcomes = list(check_driver(registry.get(name), HostClock()))
    assert [one for one in outcomes if one.level == "fail"] == []


def test_an_instrument_that_does_not_open_is_reported_with_what_to_do(wire):
    settings = DeviceSettings("t", "modbus", port=wire.path)
    (failed,) = [one for one in check_driver(Modbus(), HostClock(), settings) if one.level == "fail"]
    assert "rtd-8" in failed.text.splitlines()[1]


@pytest.fixture
def sample_package(tmp_path, monkeypatch):
    """The sample package as pip would install it."""
    project = tomllib.loads((SAMPLE / "pyproject.toml").read_text())["project"]
    (tmp_path / "sample_lux.py").write_text((SAMPLE / "sample_lux.py").read_text())
    ((name, target),) = project["entry-points"]["fieldkit.drivers"].items()
    install(tmp_path, project["name"], name, target)
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("sample_lux", None)


def test_sample_plug_in_is_short_and_conforms(sample_package, wire):
    lines = sum(len(path.read_text().splitlines()) for path in SAMPLE.glob("*.*"))
    assert lines <= 60
    wire.talk(b"LUX 98760\r\n")
    conforms(registry.get("sample-lux"), DeviceSettings("t", "sample-lux", port=wire.path), wire)


class Vanishing(Lutron):
    """Loses bytes, finds for others, opens nothing and everything."""

    def find(self):
        raise RuntimeError("no bus")

    def decode(self, data, options):
        return data[1000]

    def open(self, settings, clock):
        class Nothing:
            def close(self):
                pass

        return Nothing()


def test_driver_that_breaks_the_rules_is_caught():
    outcomes = check_driver(Vanishing(), HostClock(), DeviceSettings("t", "lutron", port="x"))
    # describing itself, finding, bytes, a missing instrument, opening
    assert levels(outcomes) == ["ok", "fail", "fail", "fail", "fail"]


class Overdue(Lutron):
    """Declares one channel and delivers two."""

    def open(self, settings, clock):
        device = super().open(settings, clock)
        read = device.read

        def doubled(timeout_s):
            found = read(timeout_s)
            return found and found._replace(values=found.values * 2)

        device.read = doubled
        return device


def test_samples_that_were_not_declared_are_caught(wire):
    wire.talk(LUX)
    outcomes = list(check_driver(Overdue(), HostClock(), DeviceSettings("t", "lutron", port=wire.path)))
    # as it delivers for the first time, and opened again
    assert [outcome.level == "fail" for outcome in outcomes[-4:]] == [True, False, True, False]


class Clinging(Lutron):
    """Takes a cut cable for silence."""

    def open(self, settings, clock):
        device = super().open(settings, clock)
        read = device.read

        def forgiving(timeout_s):
            with contextlib.suppress(DeviceLostError):
                return read(timeout_s)

        device.read = forgiving
        return device


def test_driver_that_does_not_tell_a_pulled_cable_is_caught(wire, monkeypatch):
    monkeypatch.setattr(conformance, "HAND_S", 0.3)  # no hand pulls this cable
    wire.talk(LUX)
    settings = DeviceSettings("t", "lutron", port=wire.path)
    assert levels(check_driver(Clinging(), HostClock(), settings, wire))[-2:] == ["fail", "ok"]
