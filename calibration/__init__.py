"""Calibrations: from arrays of readings to a value with an uncertainty budget, or a refusal with its fix.

Functions of arrays; sessions are read by `fieldkit.calibrate`. Readings enter as kelvin, lux or W/m2 with
UTC nanoseconds (`steady_pairs`, `light_meter`, `clock_offset`, `uniformity`), results leave as a
`CalibrationRecord`.
"""
