"""The short ``fieldkit.toml`` that ``fieldkit init`` writes: what is given, and what decides about slopes.

Given values are written as they are; the other keys that decide are commented out with their defaults, or
with an example. Removing the ``#`` of a line gives a valid file. The reference page has every key.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.exceptions import ConvertError

from fieldkit.config.toml_schema import Node, json_schema, node_at, resolve
from fieldkit.model.errors import ConfigError

HEADING = """\
# fieldkit campaign configuration. The keys that decide most; the reference page of the configuration has all.
# Commented ones have their default, or an example: remove the # to change it. Keys carry their unit.
# Tilt is from horizontal; azimuth is of the surface normal, from north, clockwise.
"""
DECIDING: Mapping[str, tuple[str, ...]] = {
    "surface": ("same", "albedo", "emissivity"),
    "estimator": ("azimuth",),
    "slab": ("depth_m",),
    "prior": ("air_sd_k", "longwave_sd_w_m2"),
    "irradiance": ("measures", "mounting"),
    "region": ("name", "kind", "points_px", "tilt_deg", "azimuth_deg", "level_sd_deg"),
}
"""Keys that stand in every new file: one heap, a known bed, meters, air in the shade, sand and light."""
NAMED = ("device", "trigger")
"""Tables of which there may be several, each with a name."""
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
    """The text of a ``fieldkit.toml`` with the values `given`, and the keys of `DECIDING` commented out."""
    parts = [HEADING + "schema = 1"]
    for name in json_schema()["properties"]:
        if name in given or name in DECIDING:
            parts.extend("\n".join(lines) for lines in _tables(name, given.get(name)))
    return "\n\n".join(parts) + "\n"


def _tables(name: str, given: Any) -> Iterator[list[str]]:
    """The lines of each table called `name`: one, or one for each region, device or trigger."""
    if name == "region" and given:
        for region in given:
            yield ["[[region]]", *(assignment(key, value) for key, value in region.items())]
    elif name in NAMED:
        for own_name, table in given.items():
            yield _table(f"[{name}.{own_name}]", (name, own_name), table)
    else:
        header, path = ("[[region]]", (name, 0)) if name == "region" else (f"[{name}]", (name,))
        yield _table(header, path, given)


def _table(header: str, path: tuple[str | int, ...], given: Mapping[str, Any] | None) -> list[str]:
    """A table's lines; if nothing is given the header is commented out too."""
    node = node_at(path) or {}
    lines = [f"# {node['description']}", header if given else f"#{header}"]
    for key, field in node["properties"].items():
        field = resolve(field)
        if given and key in given:
            lines.append(_line(key, given[key], field))
        elif key in DECIDING.get(str(path[0]), ()):
            lines.append("#" + _line(key, _example(field), field))
    return lines


def _example(field: Node) -> Any:
    default = field.get("default")
    return field["examples"][0] if default is None else default


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
