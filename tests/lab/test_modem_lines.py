"""Modem lines of a serial adapter by the kernel's own driver: read as a meter, dropped as a fail-safe."""

from fieldlab.campaign import LUX_BY_ID
from usblab.serial_port import Meter


def test_the_lines_of_an_adapter_are_read_and_dtr_drops_when_the_recorder_is_killed(lab):
    with lab.meter(Meter()):
        lab.wait_for(LUX_BY_ID)
        # QEMU's adapter asserts both where nothing at its far end states them: hw/usb/dev-serial.c
        assert lab.guest.call("inside_guest.modem_lines:values", path=LUX_BY_ID) == {
            "cts": 100.0,
            "dsr": 100.0,
        }
        dropped_s = lab.guest.call("inside_guest.modem_lines:dtr_drops_after_kill_s", path=LUX_BY_ID)
    assert dropped_s < 5.0
