"""What is wrong with a configuration, in sentences: where, which key, what was expected."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from fieldkit.config.lines import Path
from fieldkit.config.schema import expected, known_keys, node_at
from fieldkit.model.errors import ConfigError

UNITS = {
    "deg": "degrees",
    "c": "degrees Celsius",
    "k": "kelvin",
    "s": "seconds",
    "m": "metres",
    "m_s": "metres per second",
    "px": "pixels",
    "lx": "lux",
    "mb": "megabytes",
    "lm_w": "lumen per watt",
    "w_m_k": "watts per metre and kelvin",
    "w_m2": "watts per square metre",
    "j_m3_k": "joules per cubic metre and kelvin",
    "kg_m3": "kilograms per cubic metre",
    "j_kg_k": "joules per kilogram and kelvin",
}
"""How keys end, and what that means."""

OTHER_UNITS = ("rad", "f", "ms", "min", "h", "cm", "mm", "km", "ft", "klx", "gb", "kj_kg_k", "percent")
"""Units that are not taken; a key in one of them is answered with the key in fieldkit's unit."""


@dataclass(frozen=True, slots=True)
class Mistake:
    """One thing wrong with the configuration: `path` is the key, `said` what is wrong with it."""

    path: Path
    said: str

    @property
    def key(self) -> str:
        """The key as one would type it: ``site.latitude_deg``, ``region[0].points_px``."""
        name = ""
        for part in self.path:
            name += f"[{part}]" if isinstance(part, int) else f".{part}" if name else part
        return name


class ConfigMistakesError(ConfigError):
    """Everything that is wrong with a configuration; `mistakes` holds one line for each."""

    def __init__(self, mistakes: Iterable[tuple[str, Mistake]], *, fix: str | None = None) -> None:
        self.mistakes = tuple(f"{where}: {mistake.key}: {mistake.said}" for where, mistake in mistakes)
        count = f"{len(self.mistakes)} mistakes in the configuration"
        one = len(self.mistakes) == 1
        super().__init__(self.mistakes[0] if one else "\n  ".join([count, *self.mistakes]), fix=fix)


def explain(error: ValidationError, values: Mapping[str, Any]) -> list[Mistake]:
    """The mistakes pydantic found in `values`, one per key, each with what was expected there.

    A misspelled key is one mistake, not two: what it was meant to be does not also count as missing.
    """
    details = {_path_in(values, detail): detail for detail in reversed(error.errors(include_url=False))}
    unknown = {path for path, detail in details.items() if detail["type"] == "extra_forbidden"}
    meant = {(*path[:-1], _meant(path)) for path in unknown}
    told = [path for path in details if details[path]["type"] != "missing" or path not in meant]
    return [Mistake(path, _say(details[path], path)) for path in reversed(told)]


def _path_in(values: Any, detail: ErrorDetails) -> Path:
    """Where in the document; pydantic also names the branches of a union, which nobody typed."""
    path: Path = ()
    for part in detail["loc"]:
        try:
            values = values[part]
        except (KeyError, IndexError, TypeError):
            return (*path, part) if detail["type"] == "missing" else path
        path += (part,)
    return path


def _say(detail: ErrorDetails, path: Path) -> str:
    if detail["type"] == "extra_forbidden":
        return _say_unknown(path)
    if detail["type"] == "missing":
        return f"missing; expected {expected(node_at(path))}"
    return f"got {detail['input']!r}, expected {expected(node_at(path))}"


def _say_unknown(path: Path) -> str:
    typed, meant = str(path[-1]), _meant(path)
    if meant is None and (qualified := _in_a_table(path)):
        return f"unknown key; did you mean {qualified}?"
    if meant is None:
        return f"unknown key; known here: {', '.join(known_keys(path[:-1]))}"
    stem = _without_unit(meant)
    other_unit = stem == _without_unit(typed) and stem != meant
    return f"unknown key; did you mean {meant}" + (
        f", in {UNITS[meant[len(stem) + 1 :]]}?" if other_unit else "?"
    )


def _meant(path: Path) -> str | None:
    """The key that was probably meant: the same one in fieldkit's unit, or one spelled alike."""
    typed, known = str(path[-1]).lower(), known_keys(path[:-1])
    same = [key for key in known if _without_unit(key) == _without_unit(typed)]
    return next(iter(same or get_close_matches(typed, known, n=1)), None)


def _in_a_table(path: Path) -> str | None:
    """A key given without its table: ``surface.albedo`` for ``albedo``; the first table that has it."""
    if len(path) > 1:
        return None
    keys = ((table, key) for table in known_keys(()) for key in known_keys((table,)))
    typed = _without_unit(str(path[0]).lower())
    return next((f"{table}.{key}" for table, key in keys if _without_unit(key) == typed), None)


def _without_unit(key: str) -> str:
    """``tilt_rad`` and ``tilt_deg`` are both ``tilt``."""
    for unit in sorted((*UNITS, *OTHER_UNITS), key=len, reverse=True):
        if key.endswith(f"_{unit}"):
            return key.removesuffix(f"_{unit}")
    return key
