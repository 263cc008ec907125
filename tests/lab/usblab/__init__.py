"""A virtual USB lab: emulated cameras and serial meters, plugged into a real Linux kernel in an emulator.

It offers `Program` (the program under test), `Guest` (a small Linux that has it), `Lab` (plug in, run,
inspect), `UvcCamera` and `Meter` to derive instruments from, and `UsbPort` and `SerialPort` to plug them
into. It imports neither pytest nor the program under test; README.md shows how to use it for another one.
"""

from usblab.guest.machine import Guest, GuestError
from usblab.guest.missing import MissingPartError
from usblab.lab import Ended, Job, Lab
from usblab.port import UsbPort
from usblab.program import Program
from usblab.serial_port import Meter, SerialPort
from usblab.uvc.camera import UvcCamera

__all__ = [
    "Ended",
    "Guest",
    "GuestError",
    "Job",
    "Lab",
    "Meter",
    "MissingPartError",
    "Program",
    "SerialPort",
    "UsbPort",
    "UvcCamera",
]
