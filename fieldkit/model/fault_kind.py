"""The kinds of fault that a simulated scene can have; apart from the scene, so that help loads no scipy."""

from __future__ import annotations

import enum
from typing import Self


class FaultKind(enum.StrEnum):
    """Kinds of fault in a scene, each with its default duration."""

    lasts_s: float

    def __new__(cls, word: str, lasts_s: float = 0.0) -> Self:
        """Give the member of that value its duration."""
        kind = str.__new__(cls, word)
        kind._value_, kind.lasts_s = word, lasts_s
        return kind

    CLOUD = "cloud", 360.0  # a cloud passes before the sun
    CABLE = "cable", 90.0  # the camera is unplugged and plugged in again
    SHUTTER = "shutter", 240.0  # an unrequested correction leaves a wrong level until the next one
    FROZEN = "frozen", 150.0  # the camera repeats one frame
    GARBLED = "garbled", 120.0  # bytes of the serial instruments are corrupted
    DISK = "disk", 600.0  # another program fills the disk
    CLOCK = "clock"  # the computer's UTC is set forward by an hour
    SILENT = "silent", 150.0  # the camera answers but sends no more frames
    OVERRANGE = "overrange", 60.0  # the light meter shows overload
    MOVED = "moved", 600.0  # somebody kicks the tripod, and puts it back
    SHADE = "shade", 600.0  # a board shades the last bed
    DRIFT = "drift", 720.0  # the last bed is warmed by something that is not the sun
