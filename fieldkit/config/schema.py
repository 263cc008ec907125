"""What the configuration takes, in words, read from the JSON schema of its tables."""

from __future__ import annotations

import functools
from typing import Any

from fieldkit.config.lines import Path
from fieldkit.config.tables import Tables

Node = dict[str, Any]
"""A piece of a JSON schema, without references and without the ``null`` of optional keys."""


@functools.cache
def json_schema() -> Node:
    """The JSON schema of ``fieldkit.toml``, for editors that complete and check."""
    return Tables.model_json_schema()


def node_at(path: Path) -> Node | None:
    """The schema of the value that `path` leads to, or None if there is no such key."""
    node: Node | None = resolve(json_schema())
    for part in path:
        if node is None:
            return None
        node = _step(node, part)
    return node


def known_keys(path: Path) -> list[str]:
    """The keys of the table that `path` leads to."""
    return list((node_at(path) or {}).get("properties", ()))


def resolve(node: Node) -> Node:
    """The node with references followed; of an optional key, what it is when given."""
    if "$ref" in node:
        return {**json_schema()["$defs"][node["$ref"].rsplit("/", 1)[1]], **node, "$ref": None}
    branches = [branch for branch in node.get("anyOf", ()) if branch.get("type") != "null"]
    if len(branches) == 1:
        return {**resolve(branches[0]), **{key: node[key] for key in node if key != "anyOf"}}
    return node


def expected(node: Node | None) -> str:
    """What a key takes: ``a number from -90 to 90 (degrees, north positive)``."""
    if node is None:
        return "something else"
    about = node.get("description", "")
    return f"{kind(node)} ({about})" if about else kind(node)


def _step(node: Node, part: str | int) -> Node | None:
    if isinstance(part, int):
        below = node.get("items")
    else:
        named = node.get("patternProperties", {"": node.get("additionalProperties")})
        below = node.get("properties", {}).get(part, *named.values())
    return resolve(below) if isinstance(below, dict) else None


def kind(node: Node) -> str:
    """What a value is, without what it is for: ``a number from -90 to 90``."""
    if "anyOf" in node:
        return " or ".join(kind(resolve(branch)) for branch in node["anyOf"])
    if "enum" in node:
        return "one of " + ", ".join(f'"{value}"' for value in node["enum"])
    if "const" in node:
        return repr(node["const"]).replace("'", '"')
    if node.get("format") == "date-time":
        return "a time with its offset from UTC, such as 2016-01-01T12:00:00-07:00"
    if node["type"] == "array":
        return f"a list of at least {node['minItems']} values" if "minItems" in node else "a list"
    words = {"number": "a number", "integer": "a whole number", "string": "text", "boolean": "true or false"}
    return words.get(node["type"], "a table") + _range(node)


def _range(node: Node) -> str:
    if "minimum" in node and "maximum" in node:
        return f" from {node['minimum']:g} to {node['maximum']:g}"
    limits = {
        "exclusiveMinimum": "above",
        "minimum": "at least",
        "exclusiveMaximum": "below",
        "maximum": "at most",
    }
    words = [f"{word} {node[limit]:g}" for limit, word in limits.items() if limit in node]
    return " " + " and ".join(words) if words else ""
