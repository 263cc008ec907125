"""Defaults that follow from ``surface.kind`` and ``site.body``, where the configuration does not set them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fieldkit.config.files import table_in
from fieldkit.estimation.surface_kinds import KINDS, SAME, SAND, Kind
from fieldkit.physics.bodies import BODIES, EARTH, Body
from fieldkit.physics.dust import dusty_sky

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
    kind, surface = _kind(document), table_in(document, "surface")
    if surface.get("same") is True:
        document = with_defaults(document, {"prior": SAME})
    if kind == SAND:
        return document
    return with_defaults(document, KINDS[kind].defaults(albedo_stated="albedo" in surface))


def forget_defaults_of_kind(document: dict[str, Any]) -> None:
    """Remove from a document that states every value those of its kind, so that another can give them."""
    kind = KINDS[_kind(document)]
    for is_stated in (True, False):
        for name, values in kind.defaults(albedo_stated=is_stated).items():
            table = document.get(name)
            if isinstance(table, dict):
                document[name] = {key: table[key] for key in table if table[key] != values.get(key)}


def _kind(document: Mapping[str, Any]) -> Kind:
    """The kind that is stated; sand where none is, or an unknown one, which the schema refuses."""
    stated = table_in(document, "surface").get("kind")
    return next((kind for kind in KINDS if kind == stated), SAND)


HALFWAY_UP = 0.7
"""Cosine of the zenith angle."""
LEAST_EXCHANGE_W_M2_K = 0.01
"""For the prior, which is of its logarithm: nothing beside 4 W m-2 K-1 of emission."""
DEEP_M = 0.3
"""Of loose ground: heat of a Martian day does not reach its bottom."""


def with_defaults_of_world(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The plain configuration with the defaults of its site's body, where it does not set them."""
    stated = table_in(document, "site").get("body", "earth")
    body = next((BODIES[name] for name in BODIES if name == stated), EARTH)  # the schema refuses others
    if body is EARTH:
        return document
    defaults = _defaults(body)
    return with_defaults(
        document, {name: defaults[name] for name in defaults if name != "simulation" or name in document}
    )


def _defaults(body: Body) -> dict[str, dict[str, Any]]:
    ground = {"albedo": body.albedo, "emissivity": body.emissivity}
    return {
        "surface": {**ground, "reflected_temperature_c": -120.0},
        "air": {
            "heat_capacity_j_kg_k": body.air_heat_capacity_j_kg_k,
            "density_kg_m3": body.air_density_kg_m3,
            "exchange_m_s": body.surface.exchange_m_s,
        },
        "slab": {
            "depth_m": DEEP_M,
            "conductivity_w_m_k": body.conductivity_w_m_k,
            "heat_capacity_j_m3_k": body.heat_capacity_j_m3_k,
        },
        "estimator": {
            "ground_albedo": body.albedo,
            "longwave_down_w_m2": body.longwave_down_w_m2,
            "diffuse_fraction": _diffuse_fraction(body),
        },
        "prior": {"exchange_w_m2_k": max(body.exchange_w_m2_k, LEAST_EXCHANGE_W_M2_K)},
        "irradiance": {
            "model": "efficacy",
            "efficacy_lm_w": body.beam_lm_w,
            "diffuse_fraction": _diffuse_fraction(body),
        },
        "simulation": {**ground, "sand_depth_m": DEEP_M, "weather": "clear"},
    }


def _diffuse_fraction(body: Body) -> float:
    """Share of diffuse in global light, the sun halfway up."""
    dni, dhi = dusty_sky(HALFWAY_UP, 1.0, body.dust_optical_depth or 0.0)
    return round(float(dhi / (dni * HALFWAY_UP + dhi)), 3)
