"""A station's measured weather as streams: what an observatory nearby saw beside the experiment."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fieldkit.model.quantities import QUANTITIES
from fieldkit.model.samples import Severity
from fieldkit.sessions.formats import imported
from fieldkit.sessions.formats.imported import ImportedRecording
from fieldkit.weather import half_step_ns, read_station_file

_COLUMNS = {
    "dni_w_m2": "dni",
    "dhi_w_m2": "dhi",
    "ghi_w_m2": "ghi",
    "longwave_down_w_m2": "longwave_down",
    "longwave_up_w_m2": "longwave_up",
    "air_temperature_k": "air_temperature",
    "wind_m_s": "wind_speed",
    "pressure_pa": "air_pressure",
}


def read_station(path: Path, name: str = "station") -> ImportedRecording:
    """A file of SURFRAD or BSRN as streams ``NAME-direct``, ``NAME-air`` ...; stamps are middles of means.

    A quantity that was never measured gives no stream. Raises `ConfigError`.
    """
    weather = read_station_file(path)
    measured = {key: values for key in _COLUMNS if np.isfinite(values := getattr(weather, key)).any()}
    rate_hz = imported.usual_rate_hz(weather.time_ns)
    streams = tuple(
        imported.station_stream(name, QUANTITIES[_COLUMNS[key]], rate_hz, model=weather.source)
        for key in measured
    )
    readings = [
        imported.imported_reading(info.name, int(stamp), (float(value),))
        for stamp, *row in zip(weather.time_ns, *measured.values(), strict=True)
        for info, value in zip(streams, row, strict=True)
    ]
    minutes = half_step_ns(weather.time_ns) / 30e9
    note = f"{weather.source}: {weather.time_ns.size} means of {minutes:g} min, stamped in their middle"
    warnings = [(Severity.WARNING, text) for text in weather.notes]
    return ImportedRecording(streams, readings, ((Severity.INFO, note), *warnings), weather.site)
