"""Components of radiation streams: direct, global or diffuse sunlight, or longwave.

All are in W/m2, but none can replace another: 400 W/m2 of global irradiance at 22 degrees of solar elevation
belong to a beam of 900. So a stream declares its `Component`s (`StreamInfo.measures`), the configuration may
state them (``irradiance.measures``); a component that neither gives is unknown and excluded from estimates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, get_args

from fieldkit.model.device import StreamInfo

Component = Literal["dni", "ghi", "gti", "dhi", "longwave_down", "longwave_up"]
"""Direct normal, global horizontal, global tilted and diffuse horizontal irradiance; longwave both ways."""

COMPONENTS: tuple[str, ...] = get_args(Component)
UNIT = "W m-2"
UNKNOWN = ""

_QUANTITIES = ("irradiance", "longwave_irradiance")
_OLDER_IMPORTS = {
    "direct": "dni", "diffuse": "dhi", "global": "ghi",
    "longwave-down": "longwave_down", "longwave-up": "longwave_up",
}  # fmt: skip
_OLDER_PYRANOMETERS = ("Apogee SP-522", "Renke pyranometer")


def measured(info: StreamInfo, stated: Mapping[str, str]) -> tuple[str, ...]:
    """The component that each channel of a stream measures, or `UNKNOWN`.

    Empty for streams that are not radiation. `stated` are components by stream, from the configuration; they
    override what the stream declares.
    """
    if info.is_camera or info.unit != UNIT or not (info.quantity in _QUANTITIES or info.measures):
        return ()
    if info.name in stated:
        return (stated[info.name],) * info.shape[0]
    return info.measures or (_of_older_session(info),) * info.shape[0]


def with_components(info: StreamInfo, stated: Mapping[str, str]) -> StreamInfo:
    """The stream with its known components declared."""
    known = measured(info, stated)
    return replace(info, measures=known) if any(known) else info


def named(labels: Sequence[str]) -> tuple[str, ...]:
    """The components named by channel labels (``GHI``, ``DNI_Avg``, ``dhi_w_m2``); empty if none is.

    Other labels are ambiguous: ``sun``, ``radiation`` or ``pyranometer 2`` may be of any plane.
    """
    words = (label.strip().lower().removesuffix("_avg").removesuffix("_w_m2") for label in labels)
    found = tuple(word if word in COMPONENTS else UNKNOWN for word in words)
    return found if any(found) else ()


def how_to_state(stream: str) -> str:
    """Advice on the configuration of a stream whose component is unknown."""
    return f'set irradiance.measures.{stream} = "ghi", or "dni", "gti", "dhi", "longwave_down"'


def _of_older_session(info: StreamInfo) -> str:
    """The component of a stream recorded before streams declared it, where its origin is unambiguous.

    Importers of weather stations used fixed names; two register maps were of pyranometers only.
    """
    if info.driver == "import" and (info.vendor or info.model):  # tables of data loggers have neither
        return next((of for word, of in _OLDER_IMPORTS.items() if info.name.endswith(f"-{word}")), UNKNOWN)
    return "ghi" if info.driver == "modbus" and info.model in _OLDER_PYRANOMETERS else UNKNOWN
