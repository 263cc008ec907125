"""Without aravis; with its fake camera the driver runs in tests/lab/test_genicam.py."""

import sys

import pytest

from fieldkit.drivers.cameras.genicam import Genicam, _temperatures, blocks_between
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError, DeviceAccessError


@pytest.mark.parametrize(("before", "after", "count"), [(1, 2, 1), (5, 8, 3), (65_535, 1, 1), (65_534, 2, 3)])
def test_block_ids_wrap_and_are_never_zero(before, after, count):
    """GigE Vision 1: a block id has 16 bits, and 0 is reserved for test packets."""
    assert blocks_between(before, after) == count


def test_what_is_missing_is_named_with_how_to_get_it(monkeypatch):
    with pytest.raises(ConfigError, match="ir: genicam"):
        Genicam().open(DeviceSettings("ir", "genicam"), HostClock())
    monkeypatch.setitem(sys.modules, "gi", None)
    with pytest.raises(DeviceAccessError, match=r"need aravis 0\.8") as caught:
        Genicam().open(DeviceSettings("ir", "genicam", port="127.0.0.1"), HostClock())
    assert "gir1.2-aravis-0.8" in caught.value.fix


class Camera:
    """FLIR's features, as of an A-series."""

    def __init__(self, emissivity):
        self.features = {"IRFormat": "Radiometric", "ObjectEmissivity": emissivity}

    def is_feature_available(self, name):
        return self.features.get(name) is not None

    def set_string(self, name, value):
        self.features[name] = value

    def get_string(self, name):
        return self.features[name]

    get_float = get_string


@pytest.mark.parametrize(("emissivity", "reported"), [(0.95, 0.95), (1.0, 1.0), (None, None)])
def test_the_emissivity_that_the_camera_applies_is_reported(emissivity, reported):
    facts = _temperatures(Camera(emissivity), DeviceSettings("ir", "genicam"))
    assert (facts["kelvin_per_count"], facts.get("emissivity")) == (0.01, reported)
