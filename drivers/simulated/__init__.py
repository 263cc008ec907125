"""The simulated field: the far ends of the cables, looking at a scene.

Drivers stay the real ones. `terminal` is a serial line (a pseudo-terminal opened by
pyserial on the other side), `meters` the light meter and the thermometer that answer on
it, `lepton` the camera's source of buffers, `field` plugs them in. To simulate one more
instrument, write its far end and add it to a table of `field`.
"""

from fieldkit.drivers.simulated.field import PORT, SimulatedField

__all__ = ["PORT", "SimulatedField"]
