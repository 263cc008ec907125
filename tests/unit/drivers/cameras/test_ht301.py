import struct

import numpy as np
import pytest

from fieldkit.drivers.cameras.ht301 import Ht301, decode
from fieldkit.drivers.opening import open_with
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import DecodeError, DeviceError
from fieldkit.model.samples import Quality
from fieldkit.physics.camera_laws import law_named
from tests.harness.next_steps import at

COEFFICIENTS = (0.001, 1.0, 0.0, 1e-4, 0.018)


def frame(counts, width=384, fpa_raw=7620, cal_00=6000, shutter=3032, coefficients=COEFFICIENTS):
    """A frame with the metadata rows of the family; sensor 25 °C, shutter 30.05 °C by default."""
    rows = bytearray(2 * 4 * width)
    area = 2 * (3 * width if width in (384, 640) else width)
    struct.pack_into("<HH", rows, 0, fpa_raw, fpa_raw)
    struct.pack_into("<HHH5f", rows, area, cal_00, shutter, shutter, *coefficients)
    struct.pack_into("<16s16s", rows, area + 48, b"HT301 V1.0", b"HT301-00042")
    struct.pack_into("<5fH", rows, area + 254, 0.5, 20.0, 21.0, 0.45, 0.95, 3)
    return np.asarray(counts, "<u2").tobytes() + bytes(rows)


def flat(count, width=384, height=288):
    counts = np.full((height, width), count)
    counts[0, 0] += 1
    return counts


def opened(source, **options):
    return open_with(Ht301(), DeviceSettings("ir", "ht301", source=source, options=options), HostClock())


def kelvin(frame):
    return law_named(frame.law)(frame.counts, frame.metadata_rows, {})


@pytest.mark.parametrize(
    ("width", "height", "fpa_raw", "t_fpa", "cut"),
    [
        (384, 288, 7620, 25.0, int(390 - 7.05 * 25.0)),
        (240, 180, 7620, 25.0, int(390 - 7.05 * 25.0)),
        (640, 512, 6698, 25.0, int(390 - 7.05 * 25.0)),
        (256, 192, 8617, 20.0, 170),
    ],
)
def test_counts_of_a_temperature_give_it_back(width, height, fpa_raw, t_fpa, cut):
    """The published law solved for the counts at 40 °C, then turned round by the driver."""
    c1, c2, c3, c4, c5 = COEFFICIENTS
    t_s = 303.2 - 273.15
    gain = c3 * t_fpa**2 + c4 * t_fpa + c5
    beyond = (c1 * 40.0**2 + c2 * 40.0) - (c1 * t_s**2 + c2 * t_s)
    count = round(6000 - cut + beyond / gain)
    decoded = decode(frame(flat(count, width, height), width, fpa_raw))
    step = gain / (2 * c1 * 40.0 + c2)  # kelvin per count there
    assert kelvin(decoded)[5, 5] - 273.15 == pytest.approx(40.0, abs=step)
    assert decoded.fpa_temperature_k - 273.15 == pytest.approx(t_fpa, abs=0.01)
    assert decoded.metadata_rows.shape == (4, width)


def test_ends_of_fourteen_bits_are_saturated():
    assert decode(frame(flat(0x3FFE))).quality & Quality.SATURATED


def test_rows_that_make_no_sense_give_no_value():
    assert decode(frame(flat(6000), coefficients=(0.0,) * 5)).quality & Quality.NO_VALUE
    assert decode(frame(flat(6000), coefficients=(float("nan"),) * 5)).quality & Quality.NO_VALUE


def test_camera_is_switched_to_temperatures_and_declared(reel):
    source = reel(frame(np.full((288, 384), 0x8040)), frame(flat(5000)), frame(flat(5001)))
    camera = opened(source)
    assert source.written == [("zoom", 0x8020), ("zoom", 0x8004)]
    info = camera.info
    assert (info.law, info.unit, info.shape, info.metadata_shape) == ("ht301", "K", (288, 384), (4, 384))
    assert (info.serial_number, info.firmware) == ("HT301-00042", "HT301 V1.0")
    assert info.settings["camera_emissivity"] == pytest.approx(0.95)
    assert info.settings["camera_distance_m"] == 3
    frame_read = camera.read(1.0)
    assert frame_read.quality == Quality.GOOD
    assert camera.run_shutter() is True
    assert source.written[-1] == ("zoom", 0x8000)


def test_upper_range_is_counts_because_its_law_is_disputed(reel):
    source = reel(frame(flat(5000)), frame(flat(5001)))
    camera = opened(source, range="high")
    assert source.written[0] == ("zoom", 0x8021)
    assert (camera.info.unit, camera.info.law) == ("counts", "linear")
    assert camera.read(1.0).quality == Quality.NO_VALUE


def test_camera_that_stays_in_the_wrong_mode_is_explained(reel):
    with pytest.raises(DecodeError, match="wrong mode"):
        opened(reel(frame(np.full((288, 384), 0x8040))))


def test_camera_that_refuses_its_first_command_is_let_go(reel):
    source = reel(frame(flat(5000)), refuses=True)
    with pytest.raises(DeviceError, match="refused"):
        opened(source)
    assert source.closed == 1


def test_source_without_zoom_is_refused(reel, monkeypatch):
    source = reel(frame(flat(5000)))
    monkeypatch.delattr(type(source), "set_zoom")
    with pytest.raises(DeviceError, check=at(source.port)):
        opened(source)
    assert source.closed == 1


def test_the_camera_is_given_its_first_command_after_it_has_settled(reel):
    """Public programs wait: right after the stream begins, commands are ignored."""
    source = reel(frame(flat(5000)), frame(flat(5001)))
    waited = []

    class Clock(HostClock):
        def sleep(self, seconds):
            waited.append((seconds, list(source.written)))

    Ht301().open(DeviceSettings("ir", "ht301", source=source), Clock())
    assert waited == [(pytest.approx(0.3), [])]
