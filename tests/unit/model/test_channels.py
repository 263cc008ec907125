"""Which channels measure the air: by quantity, or by a name that leaves no doubt."""

import pytest

from fieldkit.model.channels import air_quantities, is_air_temperature
from fieldkit.model.device import StreamInfo

AIR, WIND = "air_temperature", "wind_speed"


def stream(name="logger", quantity="temperature", unit="K", channels=("T1",), **more):
    return StreamInfo(name, quantity, unit, (len(channels),), channels=channels, **more)


@pytest.mark.parametrize(
    ("info", "expected"),
    [
        (stream(channels=("T1", "T2", "T3", "air")), ("", "", "", AIR)),
        (stream(channels=("Tair_Avg", "Tsand_Avg")), (AIR, "")),
        (stream(channels=("AirTC_Avg", "bed")), (AIR, "")),  # Campbell Scientific, Short Cut
        (stream(channels=("T_air", "Air Temp", "air-temperature", "t_air_c")), (AIR,) * 4),
        (stream(channels=("fair", "hair dryer", "airport", "ambient")), ("",) * 4),
        (stream("air"), (AIR,)),
        (stream("air", channels=("T1", "T2")), ("", "")),  # which of the two is not known
        (stream("slv-air", AIR, channels=("1",)), (AIR,)),
        (stream("slv-wind", WIND, "m s-1", ("1",)), (WIND,)),
        (stream("slv-wind", WIND, "knots", ("1",)), ("",)),
        (stream("tower", "speed", "m s-1", ("WS_ms_Avg", "gust")), (WIND, "")),
        (stream(quantity="speed", unit="m s-1", channels=("air",)), ("",)),
        (stream(channels=("wind",)), ("",)),
        (StreamInfo("air", "brightness_temperature", "K", (120, 160)), ()),
    ],
)
def test_only_quantity_or_name_says_that_a_channel_measures_the_air(info, expected):
    assert air_quantities(info) == expected


def test_a_channel_is_found_by_name_before_number():
    info = stream(channels=("2", "bed"))
    assert [info.channel(text) for text in ("2", "bed", "1", "3", "", "air")] == [0, 1, 0, None, None, None]
    assert StreamInfo("t", "temperature", "K", (2,)).channel_names == ("1", "2")
    assert is_air_temperature("Air")
