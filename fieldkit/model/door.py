"""The door for what a notebook passes: an argument is of the kind that its annotation names, or is refused.

Arrays, sets and iterators become lists, times of NumPy are UTC; nothing else is converted.
"""

from __future__ import annotations

import ast
import builtins
import functools
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import is_dataclass
from datetime import UTC, date, datetime
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast, runtime_checkable

import numpy as np

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument, Text
from fieldkit.model.spelling import did_you_mean

if TYPE_CHECKING:
    from pydantic import TypeAdapter

T = TypeVar("T")
EXAMPLES: Mapping[str, Any] = {
    "at": "2017-08-30T12:00+09:00",
    "day": "2026-12-11",
    "duration": "20m",
    "facets": [(15.0, 180.0)],
    "latitude_deg": 37.7,
    "longitude_deg": -105.92,
    "parameters": {"albedo": [0.15, 0.20, 0.25]},
    "points_px": [(10, 10), (40, 10), (40, 30)],
    "session": "recordings/20261211T030000Z.h5",
    "sessions": ["a.h5", "b.h5"],
    "settings": {"albedo": 0.25},
    "site": (37.7, -105.92, 2317.0),
    "window": "20m",
}
"""A value of each argument."""


def checked(thing: T) -> T:
    """A function, or a class with its constructor and its methods, that refuses arguments of other kinds.

    It raises `ConfigError` with the argument as its place; for a name that it has not, with the nearest.
    """
    if inspect.isfunction(thing):
        return cast("T", _checked(thing))
    for name, member in list(vars(thing).items()):
        if inspect.isfunction(member) and (name == "__init__" or not name.startswith("_")):
            setattr(thing, name, _checked(member))
    return thing


def _checked(function: Callable[..., T]) -> Callable[..., T]:
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> T:
        bound = _bind(signature, args, kwargs)
        kinds = kinds_of(function)
        for name, value in bound.arguments.items():
            if name in kinds:
                annotation = str(signature.parameters[name].annotation)
                bound.arguments[name] = _accepted(name, _plain(value), kinds[name], annotation)
        return function(*bound.args, **bound.kwargs)

    return call


def _bind(signature: inspect.Signature, args: Any, kwargs: Mapping[str, Any]) -> inspect.BoundArguments:
    """The arguments by name; raises `ConfigError` where one has no such name, is missing or too many."""
    try:
        return signature.bind(*args, **kwargs)
    except TypeError as error:
        names = [name for name in signature.parameters if name != "self"]
        unknown = [name for name in kwargs if name not in names]
        missing = [name for name in names if f"{name!r}" in str(error)]
        place, *_ = unknown or missing or names or [""]
        fix = did_you_mean(place, names) if unknown else f"choose one of {', '.join(names)}"
        raise ConfigError(str(error), place=Argument(place), fix=fix) from None


@functools.cache
def kinds_of(function: Callable[..., Any]) -> dict[str, TypeAdapter[Any]]:
    """Validators of the arguments whose annotations name a kind."""
    from pydantic import ConfigDict, TypeAdapter

    accept = ConfigDict(arbitrary_types_allowed=True)
    parameters = inspect.signature(function).parameters.values()
    names = _Names(function.__globals__)
    many = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    named = {argument.name: argument.annotation for argument in parameters if argument.kind not in many}
    hints = {name: eval(hint, {}, names) for name, hint in named.items() if isinstance(hint, str)}
    # in a tuple, because a dataclass alone takes no configuration
    return {name: TypeAdapter(tuple[hint], config=accept) for name, hint in hints.items()}  # type: ignore[valid-type]


class _Names(dict[str, Any]):
    """Names of annotations in a module, numbers and texts strict; some it imports for type checkers alone."""

    def __init__(self, module: Mapping[str, Any]) -> None:
        self._module = module

    def __missing__(self, name: str) -> Any:
        from pydantic import BeforeValidator, GetPydanticSchema, Strict
        from pydantic_core import core_schema

        if name in ("Iterable", "Collection"):  # of which a text is one, letter by letter
            return Sequence
        value = self._module.get(name, getattr(builtins, name, None)) or self._for_type_checkers(name)
        if value is date:
            return Annotated[date, BeforeValidator(_day), Strict()]
        if value in (str, int, float, bool, bytes, datetime):
            return Annotated[value, Strict()]
        if getattr(value, "_is_protocol", False):
            return runtime_checkable(value)
        if isinstance(value, type) and is_dataclass(value):  # not the kinds of its fields as well
            return Annotated[Any, GetPydanticSchema(lambda *_: core_schema.is_instance_schema(value))]
        return value

    def _for_type_checkers(self, name: str) -> Any:
        tree = ast.parse(Path(self._module["__file__"]).read_text("utf-8"))
        imports = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
        home = next(node.module for node in imports if name in (alias.name for alias in node.names))
        return getattr(import_module(str(home)), name)


def _day(value: Any) -> Any:
    return value.date() if isinstance(value, datetime) else value


def _accepted(name: str, value: Any, kind: TypeAdapter[Any], annotation: str) -> Any:
    from pydantic import ValidationError

    if isinstance(value, Sequence) and type(value).__module__.startswith("fieldkit"):
        return value  # a campaign's sessions would all be opened
    try:
        return kind.validate_python((value,))[0]
    except ValidationError as error:
        details = (detail for detail in error.errors() if detail["type"] == "literal_error")
        choices = next((detail["ctx"]["expected"] for detail in details), "")
        expected = choices or re.sub(r"\w+", _public, annotation)
    fix: Text = Argument(name, EXAMPLES[name]) if name in EXAMPLES else f"give {expected}"
    if choices and isinstance(value, str):
        fix = did_you_mean(value, re.findall(r"'(.*?)'", expected))
    with suppress(ValidationError):
        kind.validate_python(([value],))
        fix = Argument(name, [value])
    raise ConfigError(f"got {repr(value)[:80]}, expected {expected}", place=Argument(name), fix=fix)


def _public(name: re.Match[str]) -> str:
    """A name of an annotation as a notebook has it."""
    words = {"SessionOrFile": "Session | str | Path", "Settings": "Mapping[str, Any] | Sequence[str]"}
    public = sys.modules["fieldkit"].__all__
    return f"fieldkit.{name[0]}" if name[0] in public else words.get(name[0], name[0])


def _plain(value: Any) -> Any:
    """Python's own numbers, lists and times for those of NumPy and pandas."""
    if isinstance(value, np.datetime64):
        moment = value.astype("datetime64[us]").item()
        return moment.replace(tzinfo=UTC) if isinstance(moment, datetime) else value
    if isinstance(value, np.generic):
        return value.item()
    if hasattr(value, "to_numpy") and hasattr(value, "__len__"):  # of pandas and xarray
        value = value.to_numpy()
    if isinstance(value, np.ndarray | Set | Iterator) and not hasattr(value, "read"):  # a file stays open
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: item.tolist() if isinstance(item, np.ndarray) else item for key, item in value.items()}
    if type(value) in (list, tuple):
        return type(value)(map(_plain, value))
    return value
