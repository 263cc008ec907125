import math

import pytest

from fieldkit.drivers.meters.nmea import Nmea, parse
from fieldkit.model.device import DeviceSettings
from fieldkit.model.samples import NO_COUNTER, Quality

GGA = b"$GPGGA,021530.00,3541.3668,N,13945.3012,E,2,11,0.86,38.4,M,39.5,M,,0000*66\r\n"
RMC = b"$GPRMC,021530.00,A,3541.3668,N,13945.3012,E,0.02,77.52,211126,,,A*6B\r\n"


def test_position_and_time_are_recorded(wire):
    wire.talk(b"3012,E,2*00\r\n" + GGA + RMC)
    device = wire.open(Nmea(), DeviceSettings("gps", "nmea", port=wire.path))
    assert device.info.channels == ("latitude", "longitude", "altitude")
    readings = [device.read(1.0) for _ in range(4)]
    with_height = next(reading for reading in readings if not math.isnan(reading.values[2]))
    with_time = next(reading for reading in readings if reading.device_time != NO_COUNTER)
    assert with_height.values == pytest.approx((35.689447, 139.755020, 38.4), abs=1e-6)
    assert with_time.device_time == 1_795_227_330_000_000_000


@pytest.mark.parametrize(
    "cold",  # as gpsd's and minmea's own test logs have them
    [b"$GPRMC,,V,,,,,,,,,,N*53\r\n", b"$GPRMC,,V,,,,,,,260810,1.0,E,N*34\r\n", b"$GPZDA,,,,,00,00*48\r\n"],
)
def test_receiver_that_has_no_time_yet_is_not_garbled(cold):
    record = parse(cold)
    assert record.note.endswith("without a time")
    assert record.device_time == NO_COUNTER
    assert all(value.quality == Quality.NO_VALUE for value in record.values)


def test_half_a_sentence_and_a_date_that_no_session_can_hold_are_rejected_alone():
    for broken in (b"$GPGGA,0215", b"$GPZDA,021530.00,21,11,9999,00,00*60\r\n"):
        decoded = Nmea().decode(broken + GGA, {})
        assert [rejected.length for rejected in decoded.rejected] == [len(broken)]
        assert len(decoded.values) == 5
