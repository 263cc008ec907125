"""A session as tables: CSV for anybody, Parquet for programs. Tidy: one row a sample, units in the header."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from fieldkit.model.errors import ConfigError
from fieldkit.sessions.formats.unreadable import all_but_unreadable
from fieldkit.sessions.reader import Session

if TYPE_CHECKING:
    import pandas as pd


_NUMBER = "%.12g"
"""Twelve digits are more than any sensor has, and leave out what binary fractions add: 280.55."""
_FORMULA = re.compile(r"[=+\-@\t\r]")
"""How a cell begins that a spreadsheet may compute, text or not (OWASP, CSV injection)."""


def export_tables(session: Session, folder: Path, kind: str) -> list[Path]:
    """Write every table of a session as `kind` ("csv" or "parquet"); returns the files.

    Raises `ConfigError` where pandas (or pyarrow) is not installed, and `IncompleteError`, when all the
    others are written, for a table that cannot be read.
    """
    if find_spec("pandas") is None:
        raise ConfigError("tables need pandas", fix="pip install 'fieldkit[lab]'")
    write = _csv if kind == "csv" else _parquet
    return all_but_unreadable(
        (name, partial(_export, make, folder / f"{session.path.stem}-{name}.{kind}", write))
        for name, make in _tables(session)
    )


def _export(
    make: Callable[[], pd.DataFrame], path: Path, write: Callable[[pd.DataFrame, Path], None]
) -> Path:
    write(make(), path)
    return path


def _csv(table: pd.DataFrame, path: Path) -> None:
    safe = table.rename(columns=as_text)
    for name in safe:
        if safe[name].dtype.kind == "O":
            safe[name] = safe[name].map(as_text)
    safe.to_csv(path, date_format="%Y-%m-%dT%H:%M:%S.%fZ", float_format=_NUMBER)


def as_text(cell: str) -> str:
    """The text of a cell, with an apostrophe before what a spreadsheet would compute."""
    return f"'{cell}" if _FORMULA.match(cell) else cell


def _parquet(table: pd.DataFrame, path: Path) -> None:
    try:
        table.to_parquet(path)
    except ImportError as error:
        raise ConfigError("Parquet needs pyarrow", fix="pip install 'fieldkit[lab]'") from error


def _tables(session: Session) -> Iterator[tuple[str, Callable[[], pd.DataFrame]]]:
    for name, info in session.streams.items():
        if not info.is_camera:
            yield name, partial(session.to_pandas, name)
        elif session.regions:
            yield f"{name}-regions", partial(_regions, session, name)
    yield "slopes", partial(_slopes, session)
    yield "events", partial(_events, session)


def _index(time_ns: object) -> pd.DatetimeIndex:
    import numpy as np
    import pandas as pd

    return pd.DatetimeIndex(np.asarray(time_ns, np.int64).view("datetime64[ns]"), tz="UTC", name="time")


def _regions(session: Session, camera: str) -> pd.DataFrame:
    """One row for each picture and region."""
    import pandas as pd

    series = session.region_series(stream=camera)
    parts = [
        pd.DataFrame(
            {
                "region": name, "temperature [K]": series.mean_k[:, n], "spread [K]": series.spread_k[:, n],
                "pixels": series.pixels[n], "flags": series.flags,
            },
            index=_index(series.time_ns),
        )
        for n, name in enumerate(series.regions)
    ]  # fmt: skip
    return pd.concat(parts).sort_index(kind="stable")


def _slopes(session: Session) -> pd.DataFrame:
    import pandas as pd

    estimates = session.estimates()
    rows = [
        {
            "region": one.region, "state": one.state.name.lower(), "tilt [deg]": one.tilt_deg,
            "tilt low [deg]": one.tilt_low_deg, "tilt high [deg]": one.tilt_high_deg,
            "azimuth [deg]": one.azimuth_deg, "azimuth low [deg]": one.azimuth_low_deg,
            "azimuth high [deg]": one.azimuth_high_deg, "sensitivity [K/deg]": one.kelvin_per_degree,
            "chi-square": one.chi_square, "minutes": one.n_bins, "model": one.model, "reason": one.reason,
        }
        for one in estimates
    ]  # fmt: skip
    return pd.DataFrame(rows, index=_index([one.time_ns for one in estimates]))


def _events(session: Session) -> pd.DataFrame:
    """One row for each event, with the kind of a mark and where it ends."""
    import pandas as pd

    events = session.events()
    rows = [
        {
            "kind": one.kind.name.lower(), "severity": one.severity.name.lower(),
            "stream": one.stream, "text": one.text, "label": str(one.data.get("label", "")),
        }
        for one in events
    ]  # fmt: skip
    table = pd.DataFrame(rows, index=_index([one.time_ns for one in events]))
    table["end"] = _index([one.data.get("end_ns", pd.NaT.value) for one in events])
    return table
