"""The commented ``fieldkit.toml`` that ``fieldkit init`` writes: every key with its default and description.

Given values are written as they are; every other key is commented out with its default, or with an example
if it has none. Removing the ``#`` of a line gives a valid file.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.exceptions import ConvertError

from fieldkit.config.toml_schema import Node, json_schema, node_at, resolve
from fieldkit.model.errors import ConfigError

HEADING = """\
# fieldkit campaign configuration. Every key stands here with its default, commented:
# remove the # to change it. Keys carry their unit: _deg degrees, _s seconds, _c degrees Celsius.
# Tilt is from horizontal; azimuth is of the surface normal, from north, clockwise.
"""
EXAMPLES: Mapping[tuple[str, str], str] = {
    ("lux", "driver"): "lutron",
    ("thermometer", "driver"): "center-309",
    ("device", "driver"): "lutron",
}
NAMED: Mapping[str, str] = {"device": "second-light-meter", "trigger": "bright"}
"""Tables of which there may be several, each with a name, and the name of the example."""
COMMENT_COLUMN = 40

PAPER_SITE: Mapping[str, Any] = {
    "latitude_deg": 35.558675,
    "longitude_deg": 139.395232,
    "elevation_m": 9.0,
    "timezone": "Asia/Tokyo",
}
"""Site of the paper's experiments."""

SIMULATED: Mapping[str, Any] = tomllib.loads(
    (resources.files("fieldkit") / "data" / "simulated-campaign.toml").read_text(encoding="utf-8")
)
"""A campaign on simulated devices."""


def campaign_toml(given: Mapping[str, Any]) -> str:
    """The text of a ``fieldkit.toml`` with the values `given` and every other key commented out."""
    parts = [HEADING + "schema = 1"]
    for name in json_schema()["properties"]:
        if name != "schema":
            parts.extend("\n".join(lines) for lines in _tables(name, given.get(name)))
    return "\n\n".join(parts) + "\n"


def _tables(name: str, given: Any) -> Iterator[list[str]]:
    """The lines of each table called `name`: one, or one for each region."""
    if name == "region":
        first, *others = given or [None]
        yield _table("[[region]]", (name, 0), first)
        for region in others:
            yield ["[[region]]", *(assignment(key, value) for key, value in region.items())]
    elif name in NAMED:
        yield _table(f"[{name}.{NAMED[name]}]", (name, NAMED[name]), None)
    else:
        needed = json_schema()["properties"][name].get("default") is not None
        yield _table(f"[{name}]", (name,), {} if given is None and needed else given)


def _table(header: str, path: tuple[str | int, ...], given: Mapping[str, Any] | None) -> list[str]:
    """A table's lines; if nothing is given the header is commented out too."""
    node = node_at(path) or {}
    about = f"# {node['description']}"
    lines = [about, header if given is not None else f"#{header}"]
    for key, field in node["properties"].items():
        field = resolve(field)
        if given is not None and key in given:
            lines.append(_line(key, given[key], field))
        else:
            lines.append("#" + _line(key, _example(str(path[0]), key, field), field))
    return lines


def _example(table: str, key: str, field: Node) -> Any:
    default = field.get("default")
    if default is not None:
        return default
    value = EXAMPLES.get((table, key), field["examples"][0])
    return datetime.fromisoformat(value) if field.get("format") == "date-time" else value


def _line(key: str, value: Any, field: Node) -> str:
    choices = " | ".join(f'"{choice}"' for choice in field.get("enum", ()))
    about = f"{choices}; {field['description']}" if choices else field["description"]
    return f"{assignment(key, value)}  ".ljust(COMMENT_COLUMN) + f"# {about}"


def assignment(key: str, value: Any) -> str:
    """``key = value`` on one line, as TOML writes it; numpy's numbers and arrays, and paths, as Python's own.

    Raises `ConfigError` for a value that TOML has no form for.
    """
    inline = tomlkit.inline_table()
    try:
        inline.update({key: _plain(value)})
    except ConvertError as error:
        what = f"TOML has no form for {value!r}, a {type(value).__name__}"
        fix = "give a number, text, a time, True or False, or a list of them"
        raise ConfigError(what, place=key, fix=fix) from error
    return inline.as_string().removeprefix("{").removesuffix("}").strip()


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(element) for key, element in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(element) for element in value]
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value) if isinstance(value, Path) else value
