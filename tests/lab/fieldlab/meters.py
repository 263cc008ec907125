"""The meters of the lab, with the bytes of fieldkit's simulated instruments."""

from __future__ import annotations

from usblab.serial_port import Meter

from fieldkit.drivers.simulated.meters import center_309_record, lutron_record
from fieldlab.field import Field


class LightMeter(Meter):
    """A Lutron, lying flat, that sends a record twice a second without being asked; it has no commands."""

    every_s = 0.5

    def __init__(self, field: Field) -> None:
        self.field = field

    def unasked(self) -> bytes:
        """The illuminance of now."""
        return lutron_record(self.field.lux(), "15")


class Thermometer(Meter):
    """A Center 309 with its four probes in the first four beds; it answers `A` and `K`."""

    def __init__(self, field: Field) -> None:
        self.field = field

    def answer(self, received: bytes) -> bytes:
        """A record for each `A`, the model for each `K`."""
        answers = {
            ord("A"): lambda: center_309_record(self.field.probes_k()[:4] - 273.15),
            ord("K"): lambda: b"309\r",
        }
        return b"".join(answers[letter]() for letter in received if letter in answers)
