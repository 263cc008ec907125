"""The far ends of simulated cables: instruments that look at a scene, read by the real drivers.

`field` connects them, `lepton` is the cameras' source of buffers, `meters` reply on pseudo-terminals. To
simulate another instrument, write its far end and add it to a table of `field`.
"""

from fieldkit.drivers.simulated.field import PORT, SimulatedField

__all__ = ["PORT", "SimulatedField"]
