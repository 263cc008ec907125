"""Ranges of the numbers that a calibration takes, for the command line and for Python alike."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from numbers import Real
from typing import NamedTuple

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument


class Range(NamedTuple):
    """Least and greatest number; `above` excludes the least, `below` the greatest."""

    low: float
    high: float = math.inf
    above: bool = False
    below: bool = False

    def __contains__(self, value: object) -> bool:
        """False for what is not a finite number, too."""
        if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
            return False
        number = float(value)
        is_low = number <= self.low if self.above else number < self.low
        return not is_low and (number < self.high if self.below else number <= self.high)

    @property
    def words(self) -> str:
        """In words, for messages."""
        low = f"{'above' if self.above else 'of at least'} {self.low:g}"
        high = f", {'below' if self.below else 'at most'} {self.high:g}"
        return low if self.high == math.inf else low + high


TEMPERATURE_C = Range(-273.15, 200, above=True)
"""Above absolute zero, and below what melts solder."""
RANGES: Mapping[str, Range] = {
    "tape_emissivity": Range(0.5, 1),
    "tape_sd": Range(0.001),
    "foil_emissivity": Range(0, 0.5),
    "foil_sd": Range(0),
    "camera_emissivity": Range(0.05, 1),
    "camera_reflected_c": TEMPERATURE_C,
    "distance_m": Range(0),
    "air_c": TEMPERATURE_C,
    "humidity_percent": Range(0, 100),
    "angle_deg": Range(0, 90),
    **dict.fromkeys(
        ("camera_sd_k", "thermometer_sd_k", "probe_sd_k", "reflected_sd_k", "probe_gradient_sd_k"), Range(0)
    ),
    "sky_drift_sd_k": Range(0),
    "temperatures": Range(1),
    "reference_sd": Range(0),
    "target_sd_k": Range(0),
    "tilt_sd_deg": Range(0, above=True),
    "mark_sd_px": Range(0, above=True),
    "nearest_m": Range(0),
    "hfov_deg": Range(0, 180, above=True, below=True),
}
"""By argument of the functions in `fieldkit.calibrate`; those that may be left out may be None."""


def require_ranges(given: Mapping[str, object]) -> None:
    """Raise `ConfigError` for the first of these arguments that is beyond its range; None is not given."""
    for name, value in given.items():
        if value is not None and name in RANGES and value not in RANGES[name]:
            raise ConfigError(
                "out of range", place=Argument(name, value), fix=f"give a number {RANGES[name].words}"
            )


LONGEST_NAME = 200
"""Bytes of a record's name: with date and suffix it is a file's name, of 255 bytes at most."""


def require_name(name: str) -> str:
    """The name of a record, a part of its file's; raises `ConfigError` for what cannot be one."""
    plain = re.sub(r"[^\w.+-]+", "-", name).strip("-.")
    if name != plain or not name:
        advice = f"write {plain!r}" if plain else "write one like dry-silica-sand"
        raise ConfigError(
            "a record's name may contain letters, digits, - _ . + only", place=repr(name), fix=advice
        )
    if len(name.encode()) > LONGEST_NAME:
        raise ConfigError(
            f"a record's name has {LONGEST_NAME} bytes at most",
            place=f"{name[:20]!r}...",
            fix="shorten that text",
        )
    return name
