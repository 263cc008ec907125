"""Option types: places, facets, times, durations, regions and record names, as click types.

Angles in degrees; azimuth from north, clockwise. A time must carry its zone: a forgotten
one is the most common mistake, and worth hours of sun.
"""

from __future__ import annotations

import re
import tomllib
from functools import partial
from math import inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from fieldkit.calibration.ranges import RANGES, require_name
from fieldkit.cli.next_steps import in_commands
from fieldkit.model.clock import as_day, as_moment
from fieldkit.model.durations import parse_duration, parse_offset, parse_time_of_day
from fieldkit.model.errors import ConfigError, FieldkitError

if TYPE_CHECKING:
    from collections.abc import Callable

    from fieldkit.model.site import Site


class _Typed(click.ParamType):  # type: ignore[type-arg]
    """A click type made of a function from text; its ValueError becomes a usage error."""

    def __init__(self, name: str, parse: Callable[[str], Any]) -> None:
        self.name = name
        self._parse = parse

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The parsed value; anything but text is a default and passes unchanged."""
        if not isinstance(value, str):
            return value
        try:
            return self._parse(value)
        except FieldkitError as error:
            self.fail(in_commands(error.line), param, ctx)
        except ValueError as error:
            self.fail(f"{value!r}: {error}", param, ctx)


class _Finite:
    """Click's number types without the ``nan`` and ``inf`` that Python reads as numbers."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number; fails for text that is none, is not finite, or is out of range."""
        if isinstance(value, str):
            try:
                value = _number(value)
            except ValueError as error:
                self.fail(f"{value!r}: {error}", param, ctx)  # type: ignore[attr-defined]
        return super().convert(value, param, ctx)  # type: ignore[misc]


class _Number(_Finite, click.types.FloatParamType):
    """A finite number."""


NUMBER = _Number()


class NumberRange(_Finite, click.FloatRange):
    """A finite number of a range."""


def argument_range(name: str) -> NumberRange:
    """The range of an argument of `fieldkit.calibrate`."""
    low, high, above, below = RANGES[name]
    return NumberRange(low, None if high == inf else high, min_open=above, max_open=below)


def default_option(
    name: str, argument: str, default: Any, help: str, type: Any = None, metavar: str | None = None
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """An option whose default is shown."""
    settings = {"type": type, "default": default, "metavar": metavar, "help": help}
    return click.option(name, argument, **settings, show_default=True)


def number_option(
    name: str, argument: str, default: float | None, help: str, metavar: str | None = None
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """An option for a number with a default, an argument of `fieldkit.calibrate`."""
    return default_option(name, argument, default, help, argument_range(argument), metavar)


def minutes(low: int, high: int) -> click.ParamType:  # type: ignore[type-arg]
    """A type of durations in whole minutes within a range."""

    def parse(text: str) -> int:
        minutes = parse_duration(text) / 60.0
        if not minutes.is_integer() or not low <= minutes <= high:
            raise ValueError(f"must be whole minutes within {low}m..{high}m")
        return int(minutes)

    return _Typed("TIME", parse)


def parse_site(text: str) -> Site:
    """``LAT,LON[,ALT]`` in degrees north, degrees east (also 0 to 360), metres; the zone is UTC."""
    from fieldkit.model.site import Site  # numpy comes with it

    numbers = _numbers(text, (2, 3), "LAT,LON,ALT like 35.558675,139.395232,9")
    latitude, east, elevation = (*numbers, 0.0)[:3]
    longitude = (east + 180.0) % 360.0 - 180.0 if 180.0 < east <= 360.0 else east
    try:
        return Site(latitude, longitude, elevation)
    except ConfigError as error:
        raise ConfigError(error.problem, place=repr(text), fix=error.fix) from error


def parse_storable_text(text: str) -> str:
    r"""Text as it can be stored; a byte that is not UTF-8, as on a Latin-1 terminal, becomes ``\xe9``."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def parse_facet(text: str) -> tuple[float, float]:
    """``TILT,AZIMUTH`` in degrees."""
    tilt, azimuth = _numbers(text, (2,), "TILT,AZIMUTH like 10,180")
    if not 0.0 <= tilt <= 90.0 or not -360.0 <= azimuth <= 360.0:
        raise ValueError("tilt must lie within 0..90 and azimuth within 0..360 degrees, tilt first")
    return tilt, azimuth % 360.0


def parse_rect(text: str) -> tuple[float, float, float, float]:
    """``X,Y,WIDTH,HEIGHT`` in pixels."""
    x, y, width, height = _numbers(text, (4,), "X,Y,WIDTH,HEIGHT like 82,30,32,61")
    if width < 2 or height < 2:
        raise ValueError("width and height must be at least 2 pixels")
    return x, y, width, height


def parse_or_record(text: str) -> float | str:
    """A number, or ``@NAME`` of a calibration record."""
    if text.startswith("@") and len(text) > 1:
        return text
    return _number(text, "a number, or a record like @uniformity")


def parse_kelvin_per_count(text: str) -> float:
    """Kelvin per count; NaN for ``none``, if it is not known."""
    return nan if text == "none" else _number(text, "a number, or none")


def parse_clock_offset(text: str) -> float | Literal["auto"]:
    """Seconds to add to a table's times, or ``auto``."""
    return "auto" if text == "auto" else parse_offset(text)


def parse_frame(text: str) -> tuple[int, int]:
    """Rows and columns of ``COLSxROWS``."""
    size = re.fullmatch(r"(\d+)x(\d+)", text)
    if size is None or not (int(size[1]) and int(size[2])):
        raise ValueError("write columns x rows, such as 160x120")
    return int(size[2]), int(size[1])


def parse_speed(text: str) -> float:
    """A positive number, or infinity for ``max``."""
    speed = inf if text == "max" else _number(text, "a positive number or max")
    if not speed > 0.0:
        raise ValueError("expected a positive number or max")
    return speed


def parse_key_value(text: str) -> tuple[str, Any]:
    """``KEY=VALUE``; the value as TOML reads it, or the text itself."""
    key, equals, value = text.partition("=")
    if not equals:
        raise ConfigError("is not KEY=VALUE", place=repr(text))
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value


def parse_instrument(text: str) -> tuple[str, dict[str, Any]]:
    """``IDENTITY=DRIVER[,KEY=VALUE...]``: an identity, and its ``driver`` with options, lists in brackets."""
    identity, _, driver_text = text.partition("=")
    driver, *pairs = re.split(r",(?![^\[]*\])", driver_text)
    if not (identity and driver):
        raise ConfigError("is not IDENTITY=DRIVER, such as 10c4:ea60:A7=lutron", place=repr(text))
    return identity, {"driver": driver, **dict(map(parse_key_value, pairs))}


def _number(text: str, expected: str = "a number") -> float:
    return _numbers(text, (1,), expected)[0]


def _numbers(text: str, counts: tuple[int, ...], expected: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in counts or not all(map(isfinite, numbers)):
        raise ValueError(f"expected {expected}")
    return numbers


PATH = click.Path(path_type=Path)
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
NEW_FILE = click.Path(dir_okay=False, path_type=Path)
"""Any path; a file that exists; a file to write."""
WORDS = _Typed("TEXT", parse_storable_text)
SITE = _Typed("LAT,LON[,ALT]", parse_site)
HOUR = _Typed("HH:MM", parse_time_of_day)
DURATION = _Typed("TIME", parse_duration)
FACET = _Typed("TILT,AZIMUTH", parse_facet)
MOMENT = _Typed("TIME", as_moment)
DAY = _Typed("YYYY-MM-DD", as_day)
XY = _Typed("X,Y", partial(_numbers, counts=(2,), expected="X,Y like 82,30"))
RECT = _Typed("X,Y,WIDTH,HEIGHT", parse_rect)
LENS = _Typed(
    "K1,K2,P1,P2,K3", partial(_numbers, counts=(5,), expected="five numbers, such as -0.3,0.1,0,0,0")
)
OR_RECORD = _Typed("NUMBER|@NAME", parse_or_record)
RECORD_NAME = _Typed("NAME", require_name)
KELVIN_PER_COUNT = _Typed("K|none", parse_kelvin_per_count)
CLOCK_OFFSET = _Typed("[+-]Ns|auto", parse_clock_offset)
FRAME = _Typed("COLSxROWS", parse_frame)
SPEED = _Typed("N|max", parse_speed)
KEY_VALUE = _Typed("KEY=VALUE", parse_key_value)
INSTRUMENT = _Typed("IDENTITY=DRIVER[,KEY=VALUE]", parse_instrument)
