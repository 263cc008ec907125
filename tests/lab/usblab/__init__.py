"""A virtual USB lab: emulated cameras and serial meters, plugged into a real Linux kernel in an emulator.

It offers `Program` (the program under test), `Guest` (a small Linux that has it), `Lab` (plug in, run,
inspect), `UvcCamera` and `Meter` to derive instruments from, and `UsbPort` and `SerialPort` to plug them
into. It imports neither pytest nor the program under test; README.md shows how to use it for another one.
"""
