"""Cameras: one file per family.

A buffer enters through a source (`v4l2`, `source`), a family's `decode` gives a `DecodedFrame`, and
`camera.ThermalCamera` flags and stamps it.
"""
