"""Meters: illuminometers, radiometers, contact thermometers and positioning; one file per protocol.

Bytes enter through a port (`fieldkit.drivers.ports`), a protocol's `parse` gives a `Record`, and
`meter.Meter` converts and flags it.
"""
