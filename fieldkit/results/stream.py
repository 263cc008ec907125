"""One stream of an open session, as ``session["camera"]`` gives it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal, overload

import h5py
import numpy as np
from numpy.typing import NDArray

from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Sample
from fieldkit.model.site import Region
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.sessions import analysis
from fieldkit.sessions.analysis import Calibration, RegionSeries, channel_names
from fieldkit.sessions.reader import SessionReader
from fieldkit.sessions.stream_reader import Readings
from fieldkit.views import plots

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes


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
        held = "closed," if self._session.is_closed else f"{len(self)} samples of"
        return f"<Stream {self.name}: {held} {shape} {self.info.quantity} [{self.info.unit}]>"

    @overload
    def __getitem__(self, place: int) -> Sample: ...
    @overload
    def __getitem__(self, place: slice) -> list[Sample]: ...
    def __getitem__(self, place: int | slice) -> Sample | list[Sample]:
        """Samples by their place in the stream, from the end where it is negative; raises `IndexError`."""
        reader = self._session.stream(self.name)
        if isinstance(place, slice):
            places = range(len(self))[place]
            if places.step == 1:
                return list(reader.samples(places.start, places.stop))
            return [self[one] for one in places]
        one = range(len(self))[place]
        return next(reader.samples(one, one + 1))

    def __iter__(self) -> Iterator[Sample]:
        return self.samples()

    def times_ns(self) -> NDArray[np.int64]:
        """UTC of the samples in nanoseconds since 1970, corrected by the active time map."""
        return self._session.times_ns(self.name)

    def flags(self) -> NDArray[np.uint32]:
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
        return analysis.kelvin(
            self._session, start, stop, stream=self.name, calibration=calibration, damaged=damaged
        )

    def region_series(
        self, regions: Sequence[Region] | None = None, *, calibration: Calibration | None = None
    ) -> RegionSeries:
        """Brightness temperature of regions over time; see `Session.region_series`."""
        return analysis.region_series(self._session, regions, stream=self.name, calibration=calibration)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the brightness temperature of each region, or of a meter each channel, over local time."""
        if self.info.is_camera:
            series = self.region_series()
            values = dict(zip(series.regions, (series.mean_k - CELSIUS_ZERO_K).T, strict=True))
            return plots.lines(series.time_ns, values, "brightness temperature, °C", self._session.site, ax)
        readings = self.readings()
        values = dict(zip(channel_names(self.info), readings.values.T, strict=True))
        quantity = f"{self.info.quantity}, {self.info.unit}"
        return plots.lines(readings.time_ns, values, quantity, self._session.site, ax)

    def to_pandas(self) -> pd.DataFrame:
        """The samples as a table by UTC; see `Session.to_pandas`."""
        return analysis.to_pandas(self._session, self.name)

    def to_xarray(self) -> xr.Dataset:
        """The samples as a lazy xarray dataset; see `Session.to_xarray`."""
        return analysis.to_xarray(self._session, self.name)
