"""FLIR files become recordings: every frame, its law and the camera's own times."""

import numpy as np
import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Severity
from fieldkit.model.site import Site
from fieldkit.results.import_flir import read_flir
from fieldkit.results.importing import ImportOptions, read_source
from fieldkit.results.session import open_session
from fieldkit.sessions.formats.imported import write_imported
from fieldkit.sessions.formats.times import GIVE_TIMES
from fieldkit.sessions.layout import SessionHeader
from tests.harness.foreign_files import FFF_CONSTANTS, fff, radiometric_jpeg
from tests.harness.next_steps import steps
from tests.shared_data import shared

SITE = Site(-33.5, -70.6, 500.0, "America/Santiago")


def imported(source, folder):
    """The session of a FLIR file."""
    recording = read_flir(source, "camera")
    write_imported(folder / "a.h5", SessionHeader("t", SITE, recording.streams), recording, source.name)
    return open_session(folder / "a.h5")


def test_flir_files_keep_their_law(tmp_path):
    """Expected counts: the README beside the file; an indoor scene near room temperature."""
    with imported(shared("data/frames/flir_file/frame_000000_le.fff"), tmp_path) as session:
        counts = session.raw("camera")[0]
        assert (counts.min(), counts.max()) == (17899, 19192)
        assert session.streams["camera"].law == "planck"
        kelvin = session["camera"].kelvin()
        assert 290.0 < kelvin.min() < kelvin.max() < 310.0


ORDINARY = b"\xff\xd8\xff\xe0\0\x10JFIF\0".ljust(64, b"\0")
"""The beginning of a JPEG without temperatures."""
JPEG_LS = b"\xff\xd8\xff\xf7"
"""As the pictures of a .csq begin."""
COUNTS = np.arange(18_000, 18_035, dtype=np.uint16).reshape(5, 7)


def test_flir_sequence_keeps_every_frame_and_the_cameras_times(tmp_path):
    """Times are of the camera's clock, also where pictures hold the bytes of a file's beginning."""
    disguised = COUNTS.copy()
    disguised[2, 2:4] = np.frombuffer(b"FFF\0", "<u2")
    pictures = [COUNTS, disguised, COUNTS + 3]
    source = tmp_path / "a.seq"
    source.write_bytes(b"".join(fff(one, 1_480_000_000 + n, 500) for n, one in enumerate(pictures)))
    with imported(source, tmp_path) as session:
        assert np.array_equal(session.raw("camera")[:], np.array(pictures))
        expected = [1_480_000_000_500_000_000 + n * 10**9 for n in range(3)]
        assert session.times_ns("camera").tolist() == expected
        info = session.streams["camera"]
        assert (info.model, info.rate_hz) == ("T420", 9.0)
        assert info.settings["r1"] == pytest.approx(FFF_CONSTANTS[0x58])
        # T = B / ln(R1 / (R2 (S + O)) + F), Minkina & Dudzik, for the path is of no length
        law = 1420.1 / np.log(16125.788 / (0.0109034 * (18_000 - 5588)) + 1.0)
        assert session["camera"].kelvin(0, 1)[0, 0, 0] == pytest.approx(law, abs=0.01)


def test_radiometric_jpeg_is_one_frame_of_the_same(tmp_path):
    (tmp_path / "a.jpg").write_bytes(radiometric_jpeg(fff(COUNTS, 1_480_000_000)))
    (frame,) = read_flir(tmp_path / "a.jpg", "camera").samples
    assert isinstance(frame, Frame)
    assert np.array_equal(frame.counts, COUNTS)
    assert frame.time_ns == 1_480_000_000_000_000_000


def test_a_folder_of_radiometric_jpegs_is_a_recording_in_order_of_time(tmp_path):
    """As on the card of a hand-held camera, whose ordinary pictures lie between the thermal ones."""
    for number, second in ((1, 20), (3, 0), (5, 10)):
        jpeg = radiometric_jpeg(fff(COUNTS + number, 1_480_000_000 + second))
        (tmp_path / f"FLIR000{number}.jpg").write_bytes(jpeg)
    (tmp_path / "DC_0002.jpg").write_bytes(ORDINARY)
    (tmp_path / "FLIR0007.jpg").write_bytes(b"")
    recording = read_source(tmp_path, ImportOptions())
    frames = [frame for frame in recording.samples if isinstance(frame, Frame)]
    assert [int(frame.counts[0, 0]) - 18_000 for frame in frames] == [3, 5, 1]
    assert [frame.device_seq for frame in frames] == [0, 1, 2]
    assert not any(frame.quality for frame in frames)
    assert recording.streams[0].rate_hz == 0.1
    (warning,) = [text for severity, text in recording.notes if severity is Severity.WARNING]
    assert warning.startswith("skipped, without temperatures: DC_0002.jpg (a JPEG without")
    assert warning.endswith("and 1 more")


def test_jpegs_beside_tiff_pictures_are_only_to_look_at(tmp_path):
    (tmp_path / "a.jpg").write_bytes(radiometric_jpeg(fff(COUNTS, 1_480_000_000)))
    (tmp_path / "a.tiff").write_bytes(b"no picture")
    with pytest.raises(ConfigError, match=r"a\.tiff cannot be read|TIFF"):
        read_source(tmp_path, ImportOptions())


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "empty"),
        (fff(COUNTS, 0), "frame 0"),
        (fff(COUNTS, 1_480_000_000) + fff(COUNTS[:3], 1_480_000_001), "frame 1"),
        (fff(COUNTS, 1_480_000_000)[:-1], "cut short"),
        (fff(COUNTS, 1_480_000_000)[: -COUNTS.nbytes] + JPEG_LS.ljust(COUNTS.nbytes, b"\0"), "JPEG-LS"),
    ],
)
def test_damaged_flir_files_are_rejected_with_the_reason(tmp_path, data, words):
    (tmp_path / "a.seq").write_bytes(data)
    with pytest.raises(ConfigError, match=words) as caught:
        read_flir(tmp_path / "a.seq", "camera")
    assert caught.value.fix


@pytest.mark.parametrize("length", [1, 2, 4, 8])
@pytest.mark.parametrize("byte", [b"\0", b"\xff", b"F"])
def test_padding_after_a_flir_frame_is_not_damage(tmp_path, length, byte):
    padded = [fff(COUNTS + n, 1_480_000_000 + n) + byte * length for n in range(3)]
    (tmp_path / "a.seq").write_bytes(b"".join(padded))
    (tmp_path / "b.jpg").write_bytes(radiometric_jpeg(padded[0]))
    for name, count in (("a.seq", 3), ("b.jpg", 1)):
        recording = read_flir(tmp_path / name, "camera")
        assert len(list(recording.samples)) == count
        assert [text for severity, text in recording.notes if severity is Severity.WARNING] == []


def test_humidity_in_percent_is_that_fraction(tmp_path):
    """Relative humidity of a camera that writes 50 for one half, at 50 m, where it matters."""
    found = []
    for humidity in (0.5, 50.0):
        (tmp_path / "a.fff").write_bytes(fff(COUNTS, 1_480_000_000, changed={0x24: 50.0, 0x3C: humidity}))
        found.append(read_flir(tmp_path / "a.fff", "camera").streams[0].settings)
    assert found[0] == found[1]
    assert found[0]["humidity"] == 0.5


@pytest.mark.parametrize(
    ("offset", "value", "words"),
    [
        (0x20, 0.0, "emissivity 0"), (0x3C, 101.0, "humidity 101"), (0x3C, -0.1, "humidity -0.1"),
        (0x2C, 19.0, "air_k 19"), (0x58, float("nan"), "r1 nan"), (0x5C, 0.0, "b 0"),
        (0x24, float("inf"), "distance_m inf"), (0x70, 9e3, "through the air"),
    ],
)  # fmt: skip
def test_a_constant_without_sense_is_named_with_its_value(tmp_path, offset, value, words):
    (tmp_path / "a.fff").write_bytes(fff(COUNTS, 1_480_000_000, changed={0x24: 50.0, offset: value}))
    with pytest.raises(ConfigError, match=words) as caught:
        read_flir(tmp_path / "a.fff", "camera")
    assert caught.value.fix


def segment(marker: int, body: bytes) -> bytes:
    return b"\xff" + bytes([marker]) + (len(body) + 2).to_bytes(2, "big") + body


EXIF_OF_DJI = segment(0xE1, b"Exif\0\0MM\0*\0\0\0\x08" + b"DJI\0M3T\0")


@pytest.mark.parametrize(
    ("segments", "words", "fix"),
    [
        (EXIF_OF_DJI + segment(0xE3, bytes(40)), "of DJI, whose temperatures", "Thermal Tools"),
        (segment(0xE2, b"\1\0\0\0IJPEG\0" + bytes(70)), "of InfiRay, which fieldkit", "16-bit TIFF"),
        (EXIF_OF_DJI, "without FLIR's thermal data", "16-bit TIFF"),  # of its ordinary camera
    ],
)
def test_radiometric_jpegs_of_other_makers_are_named(tmp_path, segments, words, fix):
    """Segments as ExifTool's DJI.pm and InfiRay.pm describe them."""
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8" + segments + b"\xff\xda")
    for source in (tmp_path / "a.jpg", tmp_path):
        with pytest.raises(ConfigError, match=words) as caught:
            read_flir(source, "camera")
        assert fix in str(caught.value.fix)


IN_2000_S = 946_684_800 + 12  # 2000-01-01T00:00:12Z by date(1)


def test_a_flir_camera_whose_clock_restarted_in_2000_is_given_its_times(tmp_path):
    source, times = tmp_path / "a.seq", tmp_path / "times.csv"
    source.write_bytes(b"".join(fff(COUNTS, IN_2000_S + n) for n in range(2)))
    times.write_text("a.seq,2026-05-12T10:00:00\na.seq,2026-05-12T10:00:02\n")
    expected = [1_778_547_600_000_000_000, 1_778_547_602_000_000_000]  # 01:00 UTC by date(1)
    zoned = ImportOptions(times=times, zone="Asia/Tokyo")
    assert [frame.time_ns for frame in read_source(source, zoned).samples] == expected
    moved = read_source(source, ImportOptions(offset_s=1_778_547_600 - IN_2000_S))
    assert [frame.time_ns for frame in moved.samples] == [expected[0], expected[0] + 10**9]


def test_flir_files_without_a_clock_are_given_their_times_in_their_names(tmp_path):
    for number, name in enumerate(("20260512T010002.jpg", "20260512T010000.jpg")):
        (tmp_path / name).write_bytes(radiometric_jpeg(fff(COUNTS + number, 0)))
    named = ImportOptions(time_format="%Y%m%dT%H%M%S", zone="UTC")
    frames = [frame for frame in read_source(tmp_path, named).samples if isinstance(frame, Frame)]
    assert [int(frame.counts[0, 0]) for frame in frames] == [18_001, 18_000]
    assert frames[0].time_ns == 1_778_547_600_000_000_000
    with pytest.raises(ConfigError, match="frame 0 ") as caught:
        read_source(tmp_path, ImportOptions())
    assert caught.value.fix == GIVE_TIMES


@pytest.mark.parametrize(
    ("options", "step"),
    [
        (ImportOptions(zone="UTC"), Argument("zone")),
        (ImportOptions(offset_s="auto"), Argument("offset_s", 83)),
    ],
)
def test_options_that_a_flir_camera_with_a_clock_cannot_use_are_refused(tmp_path, options, step):
    (tmp_path / "a.fff").write_bytes(fff(COUNTS, 1_480_000_000))
    with pytest.raises(ConfigError) as caught:
        read_source(tmp_path / "a.fff", options)
    assert steps(caught.value) == [step]


@pytest.mark.parametrize("damage", [bytes(60), b"FFF\0\0", fff(COUNTS, 1_480_000_002)[:-7]])
def test_flir_sequence_with_a_damaged_end_gives_what_stands_before_it(tmp_path, damage):
    whole = b"".join(fff(COUNTS + n, 1_480_000_000 + n) for n in range(2))
    (tmp_path / "a.seq").write_bytes(whole + damage)
    recording = read_flir(tmp_path / "a.seq", "camera")
    assert len(list(recording.samples)) == 2
    severity, words = recording.notes[1]
    assert severity is Severity.WARNING
    assert "frame 2" in words
