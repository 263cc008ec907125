from fieldkit.drivers.meters.pce_174 import ASK_LIVE, Pce174
from fieldkit.model.device import DeviceSettings

RECORD = bytes.fromhex("AA DD 00 26 06 11 21 10 15 30 09 57 09 57 80 00 00 00")


def test_meter_is_polled(wire):
    wire.reply({ASK_LIVE: RECORD})
    device = wire.open(Pce174(), DeviceSettings("lux", "pce-174", port=wire.path, every_s=0.02))
    assert device.read(1.0).values == (98700.0,)
