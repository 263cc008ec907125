import math

import pytest

from fieldkit.drivers.decoding import Rejected
from fieldkit.drivers.meters.nmea import Nmea, parse
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import NO_COUNTER, Quality

GGA = b"$GPGGA,021530.00,3541.3668,N,13945.3012,E,2,11,0.86,38.4,M,39.5,M,,0000*66\r\n"
RMC = b"$GPRMC,021530.00,A,3541.3668,N,13945.3012,E,0.02,77.52,211126,,,A*6B\r\n"


def signed(body):
    check = 0
    for byte in body:
        check ^= byte
    return b"$" + body + b"*%02X\r\n" % check


def test_position_and_time_are_recorded(wire):
    wire.talk(b"3012,E,2*00\r\n" + GGA + RMC)
    device = wire.open(Nmea(), DeviceSettings("gps", "nmea", port=wire.path))
    assert device.info.channels == ("latitude", "longitude", "altitude")
    readings = [device.read(1.0) for _ in range(4)]
    with_height = next(reading for reading in readings if not math.isnan(reading.values[2]))
    with_time = next(reading for reading in readings if reading.device_time != NO_COUNTER)
    assert with_height.values == pytest.approx((35.689447, 139.755020, 38.4), abs=1e-6)
    assert with_time.device_time == 1_795_227_330_000_000_000


def test_receiver_without_a_fix_gives_no_value():
    record = parse(signed(b"GPRMC,021530.00,V,,,,,,,211126,,,N"))
    assert all(value.quality == Quality.NO_VALUE for value in record.values)
    record = parse(signed(b"GPGGA,021530.00,,,,,0,00,99.99,,,,,,"))
    assert math.isnan(record.values[0].value)


@pytest.mark.parametrize(
    "cold",  # as gpsd's and minmea's own test logs have them
    [b"$GPRMC,,V,,,,,,,,,,N*53\r\n", b"$GPRMC,,V,,,,,,,260810,1.0,E,N*34\r\n", b"$GPZDA,,,,,00,00*48\r\n"],
)
def test_receiver_that_has_no_time_yet_is_not_garbled(cold):
    record = parse(cold)
    assert record.note.endswith("without a time")
    assert record.device_time == NO_COUNTER
    assert all(value.quality == Quality.NO_VALUE for value in record.values)


@pytest.mark.parametrize(
    "own",
    [b"$PMTK010,001*2E\r\n", b"$PGRMC,A,218.8,100,6378137.000,298.257223563,0.0,0.0,0.0,A,3,1,1,4,30*72\r\n"],
)
def test_sentences_of_makers_are_let_by(own):
    record = parse(own)
    assert (record.values, record.note) == ((), own[1 : own.index(b",")].decode() + ": not read")


@pytest.mark.parametrize("broken", [GGA.replace(b"3541", b"3542"), GGA[:-5] + b"\r\n", b"$GPGGA,0215" + GGA])
def test_damaged_or_cut_sentences_are_rejected(broken):
    assert isinstance(parse(broken), Rejected)


def test_a_fix_without_height_has_no_height():
    sentence = b"GPGGA,021530.00,3541.36682,N,13945.30120,E,1,08,0.9,,M,,M,,"
    heights = [value for value in parse(signed(sentence)).values if value.channel == "altitude"]
    assert [value.quality for value in heights] == [Quality.NO_VALUE]


@pytest.mark.parametrize("cut", [b"*", b"*7", b"$GPRMC*00", b"$GPGGA,1*"])
def test_the_missing_line_end_of_the_last_sentence_is_not_counted(cut):
    given = Nmea().decode(cut, {})
    assert (sum(rejected.length for rejected in given.rejected), given.rest) == (len(cut), 0)


def test_other_sentences_are_let_by():
    assert parse(signed(b"GPGSV,1,1,01,02,03,04,05")).values == ()


def test_a_receiver_that_still_shows_its_last_place_without_a_fix_gives_no_value():
    """NMEA 0183: quality 0 in GGA and status V in RMC say that the position is not valid."""
    lost = b"GPGGA,021530.00,3541.3668,N,13945.3012,E,0,00,99.99,38.4,M,39.5,M,,"
    places = [
        item for item in parse(signed(lost)).values if item.channel in ("latitude", "longitude", "altitude")
    ]
    assert len(places) == 3
    assert all(math.isnan(one.value) and one.quality == Quality.NO_VALUE for one in places)


@pytest.mark.parametrize(
    ("mode", "is_fix"),
    [(b"A", True), (b"D", True), (b"R", True), *((one, False) for one in (b"E", b"M", b"S", b"N"))],
)
def test_a_mode_without_a_measured_position_gives_neither_place_nor_time(mode, is_fix):
    """NMEA 0183 3.0, RMC: status is V for all modes but A, D, F, P, R; some receivers write A."""
    record = parse(signed(b"GPRMC,021530.00,A,3541.3668,N,13945.3012,E,0.02,77.52,211126,,," + mode))
    assert [value.quality == Quality.GOOD for value in record.values[:2]] == [is_fix] * 2
    assert [value.channel for value in record.values[2:]] == ["utc"] * is_fix


@pytest.mark.parametrize(
    ("quality", "is_fix"), [(1, True), (5, True), (9, True), (0, False), (6, False), (7, False), (8, False)]
)
def test_a_quality_without_a_measured_position_gives_no_place(quality, is_fix):
    """NMEA 0183 3.0, GGA: 6 estimated (dead reckoning), 7 manual input, 8 simulator; NovAtel's 9 is SBAS."""
    sentence = b"GPGGA,021530.00,3541.3668,N,13945.3012,E,%d,11,0.86,38.4,M,39.5,M,,0000" % quality
    assert [value.quality == Quality.GOOD for value in parse(signed(sentence)).values[:3]] == [is_fix] * 3


def test_a_date_that_no_session_can_hold_is_a_rejected_sentence():
    assert isinstance(parse(signed(b"GPZDA,021530.00,21,11,9999,00,00")), Rejected)
