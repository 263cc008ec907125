"""Calibrations from recorded sessions: each function returns a record that is not saved until `save()`.

A session enters as argument of the function; `inputs` takes streams and regions from it, `result` is what
comes out. The arithmetic is in `fieldkit.calibration`.
"""

from fieldkit.workflows.calibrate.clock import clock, host_clock
from fieldkit.workflows.calibrate.emissivity import emissivity
from fieldkit.workflows.calibrate.emissivity_live import record_emissivity
from fieldkit.workflows.calibrate.irradiance import irradiance
from fieldkit.workflows.calibrate.measurement import MeasurementOptions
from fieldkit.workflows.calibrate.pose import pose
from fieldkit.workflows.calibrate.result import Calibration
from fieldkit.workflows.calibrate.surface import surface
from fieldkit.workflows.calibrate.uniformity import uniformity

__all__ = [
    "Calibration",
    "MeasurementOptions",
    "clock",
    "emissivity",
    "host_clock",
    "irradiance",
    "pose",
    "record_emissivity",
    "surface",
    "uniformity",
]
