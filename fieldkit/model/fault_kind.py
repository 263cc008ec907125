"""Kinds of faults in a simulated field."""

from __future__ import annotations

import enum


class FaultKind(enum.StrEnum):
    """Kinds of fault in a scene."""

    CLOUD = "cloud"  # a cloud passes before the sun
    CABLE = "cable"  # the camera is unplugged and plugged in again
    SHUTTER = "shutter"  # an unrequested correction leaves a wrong level until the next one
    FROZEN = "frozen"  # the camera repeats one frame
    GARBLED = "garbled"  # bytes of the serial instruments are corrupted
    DISK = "disk"  # another program fills the disk
    CLOCK = "clock"  # the computer's UTC is set forward by an hour
    SILENT = "silent"  # the camera answers but sends no more frames
    OVERRANGE = "overrange"  # the light meter shows overload
    MOVED = "moved"  # somebody kicks the tripod, and puts it back
    SHADE = "shade"  # a board shades the last bed
    DRIFT = "drift"  # the last bed is warmed by something that is not the sun
