"""One stream of an open session, as ``session["camera"]`` gives it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Sample
from fieldkit.model.site import Region
from fieldkit.sessions.analysis import Calibration, RegionSeries
from fieldkit.sessions.stream_reader import Readings

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from fieldkit.sessions.reader import SessionReader


class Stream:
    """One stream of a session: its samples as arrays, tables and kelvin, at corrected times.

    `info` is what was declared before the first sample: quantity, unit, shape, scale, rate.
    """

    def __init__(self, session: SessionReader, info: StreamInfo) -> None:
        self.info = info
        self._session = session

    @property
    def name(self) -> str:
        """The stream's name in the session."""
        return self.info.name

    def __len__(self) -> int:
        return self._session.count(self.name)

    def __repr__(self) -> str:
        shape = "x".join(map(str, self.info.shape))
        return f"<Stream {self.name}: {len(self)} samples of {shape} {self.info.quantity} [{self.info.unit}]>"

    def times_ns(self) -> NDArray[np.int64]:
        """UTC of the samples in nanoseconds since 1970, corrected by the active time map."""
        return self._session.times_ns(self.name)

    def flags(self) -> NDArray[np.uint16]:
        """`Quality` of the samples, each verified by its checksum; reads the whole stream."""
        return self._session.flags(self.name)

    def samples(self) -> Iterator[Sample]:
        """The samples in order: `Frame` of a camera, `Reading` of a meter."""
        return self._session.samples(self.name)

    @property
    def counts(self) -> h5py.Dataset:
        """The stored counts of a camera, (n, rows, cols) uint16, read where they are sliced; not verified."""
        return self._session.raw(self.name)

    def readings(self) -> Readings:
        """The readings of a meter as arrays; raises `SessionError` for a camera."""
        return self._session.readings(self.name)

    def kelvin(
        self,
        start: int = 0,
        stop: int | None = None,
        *,
        calibration: Calibration | None = None,
        damaged: Literal["raise", "nan"] = "raise",
    ) -> NDArray[np.float64]:
        """Brightness temperature of frames, (n, rows, cols); see `Session.kelvin`."""
        return self._session.kelvin(start, stop, stream=self.name, calibration=calibration, damaged=damaged)

    def region_series(
        self, regions: Sequence[Region] | None = None, *, calibration: Calibration | None = None
    ) -> RegionSeries:
        """Brightness temperature of regions over time; see `Session.region_series`."""
        return self._session.region_series(regions, stream=self.name, calibration=calibration)

    def to_pandas(self) -> pd.DataFrame:
        """The samples as a table by UTC; see `Session.to_pandas`."""
        return self._session.to_pandas(self.name)

    def to_xarray(self) -> xr.Dataset:
        """The samples as a lazy xarray dataset; see `Session.to_xarray`."""
        return self._session.to_xarray(self.name)
