"""A station's measured weather as streams: what an observatory nearby saw beside the experiment."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Severity
from fieldkit.sessions.formats.imported import ImportedRecording, imported_reading, usual_rate_hz
from fieldkit.weather import Weather, half_step_ns, read_station_file

_COLUMNS = {
    # our column: what the stream is called after the station's name, its quantity, unit and component
    "dni_w_m2": ("direct", "irradiance", "W m-2", "dni"),
    "dhi_w_m2": ("diffuse", "irradiance", "W m-2", "dhi"),
    "ghi_w_m2": ("global", "irradiance", "W m-2", "ghi"),
    "longwave_down_w_m2": ("longwave-down", "longwave_irradiance", "W m-2", "longwave_down"),
    "longwave_up_w_m2": ("longwave-up", "longwave_irradiance", "W m-2", "longwave_up"),
    "air_temperature_k": ("air", "air_temperature", "K", ""),
    "wind_m_s": ("wind", "wind_speed", "m s-1", ""),
    "pressure_pa": ("pressure", "air_pressure", "Pa", ""),
}


def read_station(path: Path, name: str) -> ImportedRecording:
    """A file of SURFRAD or BSRN as streams ``NAME-direct``, ``NAME-air`` ...; stamps are middles of means.

    A quantity that was never measured gives no stream. Raises `ConfigError`.
    """
    weather = read_station_file(path)
    measured = {key: values for key in _COLUMNS if np.isfinite(values := getattr(weather, key)).any()}
    streams = tuple(_stream(name, key, weather) for key in measured)
    readings = [
        imported_reading(info.name, int(stamp), (float(value),))
        for stamp, *row in zip(weather.time_ns, *measured.values(), strict=True)
        for info, value in zip(streams, row, strict=True)
    ]
    minutes = half_step_ns(weather.time_ns) / 30e9
    note = f"{weather.source}: {weather.time_ns.size} means of {minutes:g} min, stamped in their middle"
    warnings = [(Severity.WARNING, text) for text in weather.notes]
    return ImportedRecording(streams, readings, ((Severity.INFO, note), *warnings), weather.site)


def _stream(name: str, key: str, weather: Weather) -> StreamInfo:
    word, quantity, unit, component = _COLUMNS[key]
    return StreamInfo(
        f"{name}-{word}", quantity, unit, (1,), measures=(component,) if component else (),
        rate_hz=usual_rate_hz(weather.time_ns), driver="import", model=weather.source,
    )  # fmt: skip
