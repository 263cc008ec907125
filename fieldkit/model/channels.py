"""Quantity of each channel of a stream: declared, stated by the configuration, or given by its name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fieldkit.model.device import StreamInfo
from fieldkit.model.quantities import POWER, UNKNOWN, Quantity, quantity_named, row_of

AIR_TEMPERATURE, WIND_SPEED = "air_temperature", "wind_speed"


def quantity_of(info: StreamInfo) -> Quantity:
    """The row of a stream in the table of quantities; an unknown one where it has none."""
    return row_of(info.quantity, info.unit)


def radiation_components(info: StreamInfo, stated: Mapping[str, str]) -> tuple[str, ...]:
    """The component of radiation that each channel of a stream measures, "" where that is not known.

    Empty for streams that are not radiation. `stated` are components by stream, from the configuration; they
    override what the stream declares.
    """
    is_radiation = info.quantity in ("irradiance", "longwave_irradiance") or info.measures
    if info.is_camera or info.unit != POWER.stored or not is_radiation:
        return ()
    if info.name in stated:
        return (stated[info.name],) * info.shape[0]
    return info.measures or ("",) * info.shape[0]


def with_components(info: StreamInfo, stated: Mapping[str, str]) -> StreamInfo:
    """The stream with its known components declared."""
    components = radiation_components(info, stated)
    return replace(info, measures=components) if any(components) else info


def components_named(labels: Sequence[str]) -> tuple[str, ...]:
    """The components that channel labels name (``GHI``, ``dhi_w_m2``), "" for others; empty if none does."""
    components = tuple(quantity_named(label, POWER.stored) for label in labels)
    return components if any(components) else ()


def how_to_state(stream: str) -> str:
    """Advice on the configuration of a stream whose component is unknown."""
    return f'set irradiance.measures.{stream} = "ghi", or "dni", "gti", "dhi", "longwave_down"'


def air_quantities(info: StreamInfo) -> tuple[str, ...]:
    """For each channel `AIR_TEMPERATURE`, `WIND_SPEED` or ""; empty for cameras.

    Streams of these quantities measure them; of others, the channels named so, or the only channel of a
    stream that is. Any other thermometer may be anywhere, so it is not used as air temperature.
    """
    if info.is_camera:
        return ()
    if (row := quantity_of(info)).name in (AIR_TEMPERATURE, WIND_SPEED, UNKNOWN):
        return ("" if row.name == UNKNOWN else row.name,) * info.shape[0]
    names = tuple(_air_quantity(name, info.unit) for name in info.channel_names)
    return names if any(names) or len(names) > 1 else (_air_quantity(info.name, info.unit),)


def is_air_temperature(channel: str) -> bool:
    """True if a thermometer's channel is named as air temperature: ``air``, ``T_air``, ``AirTC_Avg``."""
    return _air_quantity(channel, "K") == AIR_TEMPERATURE


def _air_quantity(name: str, unit: str) -> str:
    quantity = quantity_named(name, unit)
    return quantity if quantity in (AIR_TEMPERATURE, WIND_SPEED) else ""
