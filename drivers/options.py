"""A driver's own options in the configuration: known keys, sensible types, or an error that helps."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from fieldkit.model.device import DeviceSettings, Driver
from fieldkit.model.errors import ConfigError
from fieldkit.model.spelling import did_you_mean

POSITIVE = (0.0, math.inf)
"""Ends of an option that is not negative."""
_GREATEST = sys.float_info.max  # neither NaN nor infinity lies within


def reject_unknown(settings: DeviceSettings, driver: Driver) -> None:
    """Raise `ConfigError` for the first option that a driver does not declare.

    One that declares none takes any.
    """
    allowed = getattr(driver, "options", None)
    for key in settings.options:
        if allowed is not None and key not in allowed:
            raise ConfigError(
                f"the driver {settings.driver} has no option {key!r}",
                place=settings.name,
                fix=did_you_mean(key, sorted(allowed)),
            )


def number(
    settings: DeviceSettings, key: str, default: float, within: tuple[float, float] | None = None
) -> float:
    """The option `key` as a number, `within` two ends if given; raises `ConfigError`."""
    if key not in settings.options:
        return float(default)
    value = settings.options[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _GREATEST:
        raise wrong(settings, key, value, "a number")
    if within and not within[0] <= value <= within[1]:
        least, most = (f"{end:.7g}" for end in within)
        ends = f"from {least} to {most}" if within[1] <= _GREATEST else f"of at least {least}"
        raise wrong(settings, key, value, f"a number {ends}")
    return float(value)


def whole(settings: DeviceSettings, key: str, default: int, within: tuple[int, int]) -> int:
    """The option `key` as a whole number `within` two ends; raises `ConfigError`."""
    value = number(settings, key, default, within)
    if not value.is_integer():
        raise wrong(settings, key, value, "a whole number")
    return int(value)


def flag(settings: DeviceSettings, key: str, default: bool) -> bool:
    """The option `key` as true or false; raises `ConfigError`."""
    value = settings.options.get(key, default)
    if not isinstance(value, bool):
        raise wrong(settings, key, value, "true or false")
    return value


def text(settings: DeviceSettings, key: str, default: str, choices: Sequence[str] = ()) -> str:
    """The option `key` as text, one of `choices` if there are any; raises `ConfigError`."""
    value = settings.options.get(key, default)
    if not isinstance(value, str) or (choices and value not in choices):
        listing = ", ".join(filter(None, choices))
        raise wrong(settings, key, value, f"one of {listing}" if choices else "text")
    return value


def labels(settings: DeviceSettings, default: Sequence[str]) -> tuple[str, ...]:
    """The names given to a meter's channels (option `labels`), in its own order."""
    value = settings.options.get("labels", tuple(default))
    is_list = isinstance(value, list | tuple) and all(isinstance(name, str) and name for name in value)
    if not is_list or not value or len(set(value)) < len(value):
        raise wrong(settings, "labels", value, 'a list of different names such as ["reference", "b05"]')
    return tuple(value)


def decoding_settings(driver: str, given: Mapping[str, Any]) -> DeviceSettings:
    """Options given to `Decodes.decode`, which has no instrument, as the settings of one."""
    return DeviceSettings("bytes", driver, options=given)


def kelvin_per_count(settings: DeviceSettings) -> float:
    """The option `kelvin_per_count` of cameras that do not report it; NaN without."""
    return number(settings, "kelvin_per_count", math.nan, (1e-6, 100.0))


def wrong(settings: DeviceSettings, key: str, value: Any, expected: str) -> ConfigError:
    """The error of an option that is not as expected."""
    return ConfigError(f"{key} = {value!r} is not {expected}", place=settings.name, fix=f"give {expected}")
