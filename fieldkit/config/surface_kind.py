"""Defaults that follow from ``surface.kind``, where the configuration does not set them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fieldkit.estimation.surface_kinds import KINDS, SAND, Kind

KIND = ["surface", "kind"]


def with_defaults(document: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The plain configuration with defaults, table by table, under its own keys."""
    filled = dict(document)
    for name, values in defaults.items():
        table = document.get(name, {})
        if isinstance(table, Mapping):
            filled[name] = {**values, **table}
    return filled


def with_defaults_of_kind(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The plain configuration with the defaults of its kind of surface, where it does not set them."""
    kind = _kind(document)
    return document if kind == SAND else with_defaults(document, KINDS[kind].defaults())


def forget_defaults_of_kind(document: dict[str, Any]) -> None:
    """Remove from a document that states every value those of its kind, so that another can give them."""
    for name, values in KINDS[_kind(document)].defaults().items():
        table = document.get(name)
        if isinstance(table, dict):
            document[name] = {key: table[key] for key in table if table[key] != values.get(key)}


def _kind(document: Mapping[str, Any]) -> Kind:
    """The kind that is stated; sand where none is, or an unknown one, which the schema refuses."""
    surface = document.get("surface")
    given: Any = surface.get("kind") if isinstance(surface, Mapping) else None
    return next((kind for kind in KINDS if kind == given), SAND)
