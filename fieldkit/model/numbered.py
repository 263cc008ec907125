"""Enumerations whose numbers are stored in session files."""

from __future__ import annotations

import enum
from typing import Self

_LARGEST = 255  # one byte in the file


class NumberedEnum(enum.IntEnum):
    """An enumeration that also represents members added by a newer version.

    A number without a name keeps its number and is named ``UNKNOWN_<number>``, so that files of a newer
    version can be read, shown and copied.
    """

    @classmethod
    def _missing_(cls, value: object) -> Self | None:
        if not isinstance(value, int) or not 0 <= value <= _LARGEST:
            return None
        member = int.__new__(cls, value)
        member._name_, member._value_ = f"UNKNOWN_{value}", value
        return member
