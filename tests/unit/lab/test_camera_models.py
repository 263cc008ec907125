"""The camera models against the published layouts, and against a real recording where there is one."""

import gzip
import json
import math
import struct

import numpy as np
import pytest
from usblab.models import ht301, p2pro, purethermal
from usblab.uvc.camera import GET_CUR, SET_CUR, Setup, StallError

from tests.shared_data import shared

ROWS, COLS = np.mgrid[0:288, 0:384]


def warm(rows: int, cols: int):
    """A slanted picture around 300 K that grows by 0.1 K a second."""
    slant = 295 + 10 * ROWS[:rows, :cols] / rows + 5 * COLS[:rows, :cols] / cols
    return lambda time_s: slant + 0.1 * time_s


@pytest.fixture
def lepton():
    camera = purethermal.PureThermal(warm(120, 160))
    camera.power_on(0.0)
    camera.format, camera.frame = 2, 2
    return camera


def words(camera, time_s: float) -> np.ndarray:
    picture = np.frombuffer(camera.picture(time_s), "<u2").reshape(122, 160)
    return picture[120:].ravel()


def command(camera, key, data):
    unit, selector = key
    camera.control(Setup(0x21, SET_CUR, selector << 8, unit << 8, len(data)), data)


def ask(camera, key, length=32):
    unit, selector = key
    return camera.control(Setup(0xA1, GET_CUR, selector << 8, unit << 8, length))


def test_purethermal_pixels_are_hundredths_of_kelvin(lepton):
    picture = np.frombuffer(lepton.picture(0.0), "<u2").reshape(122, 160)
    np.testing.assert_allclose(picture[:120] / 100, warm(120, 160)(0.0), atol=0.005)


def test_purethermal_telemetry_words_stand_where_the_lepton_puts_them(lepton):
    lepton.picture(12.0)
    found = words(lepton, 12.345)
    assert int(found[1]) | int(found[2]) << 16 == 12345  # uptime, ms
    assert int(found[20]) | int(found[21]) << 16 == 6  # frame counter, three a picture
    assert (found[24], found[208], found[209]) == (30315, 1, 1)


def test_purethermal_shutter_freezes_the_picture_and_says_so(lepton):
    before = lepton.picture(10.0)
    assert words(lepton, 10.1)[3] >> 4 & 3 == 0
    held = lepton.picture(10.2)[: 120 * 320]
    command(lepton, purethermal.RUN_FFC, b"\x01")
    assert lepton.picture(10.6)[: 120 * 320] == held
    assert words(lepton, 10.7)[3] >> 4 & 3 == 2
    assert ask(lepton, purethermal.FFC_STATE) == struct.pack("<I", 2)
    assert words(lepton, 11.5)[3] >> 4 & 3 == 3
    assert lepton.picture(11.6)[: 120 * 320] != before[: 120 * 320]
    assert lepton.ffc_runs == 1


def test_purethermal_gain_and_resolution_show_in_telemetry(lepton):
    command(lepton, purethermal.GAIN_MODE, struct.pack("<I", 1))
    command(lepton, purethermal.TLINEAR_RESOLUTION, bytes(4))
    picture = np.frombuffer(lepton.picture(0.0), "<u2").reshape(122, 160)
    assert (picture[121, 6], picture[121, 49]) == (1, 0)  # words 166 and 209
    np.testing.assert_allclose(picture[:120] / 10, warm(120, 160)(0.0), atol=0.05)


def test_purethermal_selectors_follow_the_commands_offsets():
    # Lepton command offsets: SYS FFC 0x40, gain mode 0x48; RAD TLinear enable 0xC0, on the second page.
    assert purethermal.RUN_FFC == (6, 0x40 // 4 + 1)
    assert purethermal.GAIN_MODE == (6, 0x48 // 4 + 1)
    assert purethermal.TLINEAR == (0x15, 0xC0 // 4 + 1 - 31)


def test_purethermal_plays_a_real_recording_unchanged(lepton):
    folder = shared("data/frames")
    name = "purethermal3/thermal_20260512_151542.raw.y16.gz"
    expected = json.loads((folder / "expected.json").read_text())[name]["frame_0"]
    data = gzip.decompress((folder / name).read_bytes())
    start = 12 + struct.unpack_from("<I", data, 8)[0] + 24
    counts = np.frombuffer(data, "<u2", 120 * 160, start).reshape(120, 160)
    lepton.kelvin = lambda _: counts / 100
    picture = np.frombuffer(lepton.picture(0.0), "<u2").reshape(122, 160)[:120]
    assert picture[60, 80] == expected["raw_60_80"]
    assert (picture.min(), picture.max()) == (expected["raw_min"], expected["raw_max"])


@pytest.fixture
def p2():
    camera = p2pro.P2Pro(warm(192, 256))
    camera.frame = 2
    return camera


def test_p2pro_lower_half_is_kelvin_times_64(p2):
    picture = np.frombuffer(p2.picture(0.0), "<u2").reshape(384, 256)
    np.testing.assert_allclose(picture[192:] / 64, warm(192, 256)(0.0), atol=1 / 128)
    assert (picture[:192] >> 8 == 128).all()  # white-hot: no colour


def test_p2pro_tells_its_firmware_date_by_the_short_command(p2):
    # 0x8405 item 1, eight bytes: code little endian, parameter little endian, length big endian
    p2.vendor(Setup(0x41, 0x45, 0x78, 0x1D00, 8), bytes.fromhex("0584 01000000 0008"))
    assert p2.vendor(Setup(0xC1, 0x44, 0x78, 0x0200, 1), b"") == b"\0"
    assert p2.vendor(Setup(0xC1, 0x44, 0x78, 0x1D08, 8), b"") == b"20220808"


def test_p2pro_gain_is_set_and_read_back_by_the_long_command(p2):
    # 0x8514 item 5, set with 0x4000 added; parameters and answer big endian
    for value in (0, 1):
        p2.vendor(Setup(0x41, 0x45, 0x78, 0x9D00, 8), bytes.fromhex(f"14c5 0005 0000000{value}"))
        p2.vendor(Setup(0x41, 0x45, 0x78, 0x1D08, 8), bytes(8))
        assert p2.properties[p2pro.GAIN] == value
    p2.vendor(Setup(0x41, 0x45, 0x78, 0x9D00, 8), bytes.fromhex("1485 0005 00000000"))
    p2.vendor(Setup(0x41, 0x45, 0x78, 0x1D08, 8), bytes.fromhex("00000000 00000002"))
    assert p2.vendor(Setup(0xC1, 0x44, 0x78, 0x1D10, 2), b"") == b"\0\1"


def test_p2pro_calibration_holds_the_picture(p2):
    before = p2.picture(10.0)
    p2.vendor(Setup(0x41, 0x45, 0x78, 0x1D00, 8), bytes.fromhex("0dc1 00000000 0000"))
    assert p2.picture(10.5) == before
    assert p2.picture(11.0) != before
    assert p2.calibrations == 1


def test_p2pro_refuses_requests_that_are_not_its_own(p2):
    with pytest.raises(StallError):
        p2.vendor(Setup(0x41, 0x46, 0x78, 0x1D00, 8), bytes(8))


@pytest.fixture
def ht():
    camera = ht301.HT301(warm(288, 384))
    command(camera, ht301.ZOOM, struct.pack("<H", 0x8004))
    return camera


def law(counts: float, meta: np.ndarray) -> float:
    """The published temperature law with the constants of the metadata rows; °C at emissivity 1."""
    area = meta[3 * 384 :]
    c1, c2, c3, c4, c5 = np.frombuffer(area[3:13].tobytes(), "<f4").tolist()
    fpa = 20 - (float(meta[1]) - 7800) / 36
    shutter = float(area[1]) / 10 - 273.15
    offset = float(area[0]) - max(0, int(390 - 7.05 * fpa))
    p, q = c2 / (2 * c1), c2**2 / (4 * c1**2)
    gain = c3 * fpa**2 + c4 * fpa + c5
    return math.sqrt(((counts - offset) * gain + c1 * shutter**2 + c2 * shutter) / c1 + q) - p


def test_ht301_counts_and_metadata_give_back_the_temperature(ht):
    picture = np.frombuffer(ht.picture(0.0), "<u2").reshape(292, 384)
    meta = picture[288:].ravel()
    for row, col in ((0, 0), (100, 200), (287, 383)):
        assert law(float(picture[row, col]), meta) == pytest.approx(
            warm(288, 384)(0.0)[row, col] - 273.15, abs=0.02
        )


def test_ht301_names_its_hottest_and_coldest_pixel(ht):
    picture = np.frombuffer(ht.picture(0.0), "<u2").reshape(292, 384)
    counts, meta = picture[:288], picture[288:].ravel()
    for (x, y, raw), extreme in ((meta[2:5], counts.max()), (meta[5:8], counts.min())):
        assert counts[y, x] == raw == extreme


def test_ht301_shutter_holds_the_picture_between_closing_and_opening(ht):
    ht.picture(10.0)
    command(ht, ht301.ZOOM, struct.pack("<H", 0x8000))
    moving, held = ht.picture(10.2), ht.picture(10.4)
    assert ht.picture(10.7) == held == moving
    assert ht.picture(10.9) != held
    assert ht.commands == [0x8004, 0x8000]
