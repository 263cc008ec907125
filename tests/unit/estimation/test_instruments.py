import numpy as np
import pytest

from fieldkit.device import StreamInfo
from fieldkit.estimation.binner import Binner
from fieldkit.estimation.bins import OpenMinute
from fieldkit.estimation.instruments import Instruments
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.physics.clearsky import clear_sky
from fieldkit.physics.facet import normal
from fieldkit.physics.irradiance import IrradianceModel
from fieldkit.physics.sky import sky_view
from fieldkit.physics.sun import sun_vectors
from fieldkit.samples import Quality, Reading
from fieldkit.site import Site

SITE = Site(35.558675, 139.395232, 9.0)
METERS = {
    "pyrheliometer": IrradianceModel(kind="pyrheliometer"),
    "sun-pointing": IrradianceModel(kind="calibrated", factor=1.0, mounting="sun-pointing"),
    "in-plane": IrradianceModel(
        kind="calibrated", factor=1.0, mounting="in-plane", plane_tilt_deg=30.0, plane_azimuth_deg=180.0
    ),
    "horizontal": IrradianceModel(kind="calibrated", factor=1.0),
}


def cloudless(meter: str, time_ns: np.ndarray) -> np.ndarray:
    """What a meter reads from night to night under a clear sky."""
    sun = sun_vectors(time_ns, SITE, refraction=True)
    beam, sky = clear_sky(sun[:, 2], time_ns, SITE.elevation_m)
    if meter == "pyrheliometer":
        return beam
    if meter == "sun-pointing":
        return 108.0 * beam + 130.0 * sky * sky_view(sun[:, 2])
    facet = normal(30.0, 180.0) if meter == "in-plane" else normal(0.0, 0.0)
    return 108.0 * beam * np.maximum(sun @ facet, 0.0) + 130.0 * sky * sky_view(facet[2])


@pytest.mark.parametrize("meter", METERS)
@pytest.mark.parametrize("start", ["2017-08-29T19:30", "2017-12-10T21:00"])
def test_a_cloudless_day_from_before_sunrise_has_no_clouds(meter, start):
    time_ns = int(np.datetime64(start, "ns").astype(np.int64)) + np.arange(0, 14 * 3600, 30) * 10**9
    quantity, unit = ("irradiance", "W m-2") if meter == "pyrheliometer" else ("illuminance", "lx")
    streams = (StreamInfo("light", quantity, unit, (1,)),)
    binner = Binner(SITE, (), streams, EstimatorSettings(irradiance=METERS[meter]))
    closed = []
    for at, value in zip(time_ns.tolist(), cloudless(meter, time_ns).tolist(), strict=True):
        closed += binner.add(Reading("light", at, at, (value,)))
    closed += binner.finish()
    assert len(closed) == 14 * 60
    assert not any(entry.flags & Quality.CLOUD for entry, _ in closed)
    assert not any(notices for _, notices in closed)


@pytest.mark.parametrize("doubt", [Quality.BAD_CRC, Quality.FROZEN, Quality.OVERRANGE])
def test_contact_readings_in_doubt_stay_out_of_the_mean(doubt):
    instruments = Instruments((StreamInfo("probe", "temperature", "degC", (2,)),), IrradianceModel())
    minute = OpenMinute(0, 0)
    for second, value in enumerate([25.0, 9000.0, 27.0]):
        quality = doubt if value > 100.0 else Quality.GOOD
        minute.add_reading(Reading("probe", second, second * 10**9, (value, 20.0), quality=quality))
    assert instruments.contact_k(minute) == pytest.approx((299.15, 293.15))


def test_a_probe_all_of_whose_readings_are_in_doubt_has_no_temperature():
    instruments = Instruments((StreamInfo("probe", "temperature", "degC", (2,)),), IrradianceModel())
    minute = OpenMinute(0, 0)
    minute.add_reading(Reading("probe", 0, 0, (9000.0, 20.0), quality=Quality.BAD_CRC))
    assert np.isnan(instruments.contact_k(minute)).tolist() == [True, True]
