"""A driver for a light meter that says ``LUX 98760`` on a serial line: all that a plug-in package needs."""

import re

from fieldkit.drivers.decoding import Layout, Record, Rejected, Value
from fieldkit.drivers.framing import Line
from fieldkit.drivers.meters import meter
from fieldkit.drivers.ports import SerialDriver, open_port

LINE = Line(9600)
RECORD = re.compile(rb"LUX (\d{1,6})\r?")


def parse(buffer):
    """The line at the start of `buffer`."""
    end = buffer.find(b"\n")
    if end < 0:
        return None
    found = RECORD.fullmatch(buffer[:end])
    if not found:
        return Rejected(end + 1, "not LUX and a number")
    return Record.of(end + 1, (Value(float(found[1]), "lx", "lux"),))


LAYOUT = Layout(parse, longest=12)


class SampleLux(SerialDriver):
    """Driver of the sample light meter."""

    name = "sample-lux"
    title = "Sample light meter"
    quantity = "illuminance"
    options = meter.OPTIONS
    layout = LAYOUT
    caveat = "any adapter"

    def open(self, settings, clock):
        """Open the port and wait for the first line."""
        port = open_port(settings, LINE, clock)
        meter.first_record(port, LAYOUT, settings.name, "switch the meter on", settings.every_s)
        info = meter.describe(settings, port, LAYOUT, "illuminance", "lx", ("lux",))
        return meter.Meter(info, port, LAYOUT, clock, ("lux",))
