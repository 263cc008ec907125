"""Calibrations from recorded sessions: each function returns a record that is not saved until `save()`.

A session enters as argument of the function; `inputs` takes streams and regions from it, `result` is what
comes out. The arithmetic is in `fieldkit.calibration`.
"""

from fieldkit.calibrate.clock import clock, host_clock
from fieldkit.calibrate.emissivity import emissivity
from fieldkit.calibrate.emissivity_live import record_emissivity
from fieldkit.calibrate.horizon import horizon_from_dem, horizon_from_skyline, write_horizon
from fieldkit.calibrate.irradiance import irradiance
from fieldkit.calibrate.measurement import MeasurementOptions
from fieldkit.calibrate.pose import pose
from fieldkit.calibrate.result import Calibration
from fieldkit.calibrate.surface import surface
from fieldkit.calibrate.uniformity import uniformity
from fieldkit.model.door import checked as _checked

__all__ = [
    "Calibration",
    "MeasurementOptions",
    "clock",
    "emissivity",
    "horizon_from_dem",
    "horizon_from_skyline",
    "host_clock",
    "irradiance",
    "pose",
    "record_emissivity",
    "surface",
    "uniformity",
    "write_horizon",
]

for _name in __all__[2:]:
    globals()[_name] = _checked(globals()[_name])
