"""Dataclasses from their plain (JSON) form, which may come from a newer version or be hostile."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")


def build(kind: type[T], plain: Any) -> T:
    """The dataclass whose fields a mapping has; fields of a newer version are skipped.

    Raises `ValueError` where a value is not of its field's type, `TypeError` where one is missing that has
    no default.
    """
    if not isinstance(plain, Mapping):
        raise ValueError(f"{kind.__name__} is {type(plain).__name__}, not a mapping")
    types = _field_types(kind)  # type: ignore[arg-type]  # mypy takes no type[T] for hashable
    present = {name: item for name, item in types.items() if name in plain}
    return kind(**{name: _value(item, plain[name], name) for name, item in present.items()})


@cache
def _field_types(kind: type) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {item.name: hints[item.name] for item in fields(kind)}


def _value(kind: Any, plain: Any, name: str) -> Any:
    """A value of a field's type."""
    if kind is Any or type(plain) is kind:
        return plain
    if get_origin(kind) is UnionType:  # a type or None
        return None if plain is None else _value(get_args(kind)[0], plain, name)
    if get_origin(kind) is tuple and isinstance(plain, list | tuple):
        return _tuple(get_args(kind), plain, name)
    if isinstance(kind, type) and is_dataclass(kind):
        return build(kind, plain)
    if kind is float and isinstance(plain, int) and not isinstance(plain, bool):
        return float(plain)
    if kind is str and isinstance(plain, int | float):
        return str(plain)
    expected = get_origin(kind) or (int if issubclass(kind, enum.Enum) else kind)
    if not isinstance(plain, expected) or (isinstance(plain, bool) and expected is not bool):
        raise ValueError(f"{name} is {str(plain)[:40]!r}, not {getattr(kind, '__name__', kind)}")
    return kind(plain) if issubclass(expected, int) else plain


def _tuple(kinds: tuple[Any, ...], plain: Any, name: str) -> tuple[Any, ...]:
    """A tuple of any length (``tuple[int, ...]``), or of one type for each place."""
    each = kinds[:1] * len(plain) if kinds[-1] is Ellipsis else kinds
    if len(each) != len(plain):
        raise ValueError(f"{name} has {len(plain)} values, not {len(each)}")
    return tuple(_value(kind, item, name) for kind, item in zip(each, plain, strict=True))
