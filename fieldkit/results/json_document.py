"""JSON documents as `--json` prints them and result files hold them: ``"schema": 1`` first, NaN as null."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from fieldkit.model.learnt import Learnt

JSON_SCHEMA = 1


def to_json(document: Mapping[str, Any], indent: int | None = 2) -> str:
    """A JSON document with ``"schema": 1`` in front; NaN becomes null."""
    plain = _plain({"schema": JSON_SCHEMA, **document})
    return json.dumps(plain, indent=indent, allow_nan=False, ensure_ascii=False)


def plain_json(document: Mapping[str, Any]) -> str:
    """A JSON document as it is, on one line, for a message that is not kept; NaN becomes null.

    In ASCII: a message is sent as UTF-8, in which the name of a file need not be.
    """
    return json.dumps(_plain(document), allow_nan=False, separators=(",", ":"))


def attributes(source: Any, *names: str) -> dict[str, Any]:
    """Attributes of an object under their own names, as a part of a document."""
    return {name: getattr(source, name) for name in names}


def learnt_document(learnt: Learnt | None) -> dict[str, Any] | None:
    """Document of what was learnt: parameters in their units, residuals in kelvin; None with other models."""
    return None if learnt is None else asdict(learnt)


def _plain(value: Any) -> Any:
    """Lists, dicts, numbers and text only; NaN and infinity, which JSON does not have, become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # a numpy array or scalar
        return _plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if abs(value) < float("inf") else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return value.isoformat() if hasattr(value, "isoformat") else str(value)
