"""Physics of sun, surface and radiation: pure functions, arrays in, arrays out.

No files, no clock, no logging. A sample enters as kelvin (`camera_laws`), as direct normal irradiance
(`irradiance`) and as the sun's position at its time (`sun`); `energy_balance` and `slab` relate them to a
slope.
"""
