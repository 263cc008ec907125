"""Grids of parameters: ``surface.albedo=0.15:0.35:0.05`` and ``estimator.model=paper,full``."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from fieldkit.model.errors import ConfigError

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
RANGE = re.compile(rf"({NUMBER}):({NUMBER}):({NUMBER})")
MOST_VALUES = 10_000


@dataclass(frozen=True)
class Parameter:
    """A key of ``fieldkit.toml`` and the values to try, as they are written."""

    key: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class Grid:
    """Every combination of the parameters' values; `sets` lists them, the last parameter fastest."""

    parameters: tuple[Parameter, ...]

    @property
    def sets(self) -> list[tuple[str, ...]]:
        """Each set of parameters as ``KEY=VALUE``; a grid of none has one, as configured."""
        options = [
            [f"{parameter.key}={value}" for value in parameter.values] for parameter in self.parameters
        ]
        return list(itertools.product(*options))

    @property
    def varied(self) -> tuple[Parameter, ...]:
        """The parameters of more than one value."""
        return tuple(parameter for parameter in self.parameters if len(parameter.values) > 1)


def read_grid(settings: Sequence[str]) -> Grid:
    """The grid that ``--set`` asks for; raises `ConfigError`.

    ``LOW:HIGH:STEP`` counts with both ends, in decimal, so that 0.15:0.35:0.05 holds 0.3 and not
    0.30000000000000004. ``A,B,C`` is a list; a list in brackets is one value.
    """
    parameters = [_parameter(setting) for setting in settings]
    keys = [parameter.key for parameter in parameters]
    for key in keys:
        if keys.count(key) > 1:
            raise ConfigError(f"--set {key} is given more than once", fix=f"write one list: {key}=A,B,C")
    return Grid(tuple(parameters))


def _parameter(setting: str) -> Parameter:
    key, equals, text = (part.strip() for part in setting.partition("="))
    if not equals or not key or not text:
        raise ConfigError(f"--set {setting}: no value", fix="write it as --set surface.albedo=0.15:0.35:0.05")
    if text.startswith("["):
        return Parameter(key, (text,))
    values: list[str] = []
    for piece in text.split(","):
        match = RANGE.fullmatch(piece.strip())
        values.extend(_counted(setting, *map(Decimal, match.groups())) if match else [piece.strip()])
    return Parameter(key, tuple(dict.fromkeys(values)))


def _counted(setting: str, low: Decimal, high: Decimal, step: Decimal) -> list[str]:
    if step <= 0 or high < low or (high - low) / step > MOST_VALUES:
        raise ConfigError(
            f"--set {setting}: {low} to {high} in steps of {step} is no range",
            fix="write LOW:HIGH:STEP, STEP above 0",
        )
    return [format(low + count * step, "f") for count in range(int((high - low) / step) + 1)]
