"""`Session`: one recording, and everything that can be done with it.

The stored samples are read by `fieldkit.sessions.reader.SessionReader`, which this class extends by arrays
and tables, and by what needs other rooms: configuration, estimation, reports, plots.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import h5py

from fieldkit.model.arrays import FlagArray, FloatArray, IntArray
from fieldkit.model.device import StreamInfo
from fieldkit.model.door import checked
from fieldkit.model.errors import SessionError
from fieldkit.model.next_step import Action
from fieldkit.model.samples import Sample
from fieldkit.model.site import Region
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.phrases import counted
from fieldkit.sessions import analysis
from fieldkit.sessions.analysis import Calibration, RegionSeries, channel_names
from fieldkit.sessions.reader import SessionReader, open_as
from fieldkit.sessions.stream_reader import Readings
from fieldkit.sessions.superblock import BinaryFile
from fieldkit.views import formatting, html, plots

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes

    from fieldkit.estimation.estimator_keys import Model
    from fieldkit.results.check import CheckedSession
    from fieldkit.results.export import Export
    from fieldkit.results.report import Report
    from fieldkit.results.session_estimates import Estimates
    from fieldkit.results.slope_map import MappedSession, Window
    from fieldkit.results.sources import Settings


class Stream:
    """One stream of an open session, as ``session["camera"]`` gives it: arrays, tables, kelvin.

    Times are corrected. `info` is what was declared before the first sample: quantity, unit, shape, scale.

    Examples
    --------
    >>> camera, lux = session["camera"], session["lux"]
    >>> lux
    <Stream lux: 1200 samples of 1 illuminance [lx]>
    >>> camera.kelvin(0, 1).shape
    (1, 120, 160)
    >>> camera.region_series().mean_k.shape
    (60, 4)
    >>> dict(camera.to_xarray().sizes)
    {'time': 60, 'y': 120, 'x': 160, 'metadata_row': 2}
    >>> lux.to_pandas().columns.tolist()
    ['illuminance [lx]', 'seq', 'flags', 'mono_ns']
    >>> lux.readings().values.shape, sum(1 for sample in lux.samples())
    ((1200, 1), 1200)
    >>> lux.times_ns().size == lux.flags().size == len(lux)
    True
    >>> lux.plot().get_ylabel()
    'illuminance, lx'
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
        contents = "closed," if self._session.is_closed else f"{counted(len(self), 'sample')} of"
        return f"<Stream {self.name}: {contents} {shape} {self.info.quantity} [{self.info.unit}]>"

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
            return [self[place] for place in places]
        number = range(len(self))[place]
        return next(reader.samples(number, number + 1))

    def __iter__(self) -> Iterator[Sample]:
        return self.samples()

    def times_ns(self) -> IntArray:
        """UTC of the samples in nanoseconds since 1970, corrected by the active time map."""
        return self._session.times_ns(self.name)

    def flags(self) -> FlagArray:
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
    ) -> FloatArray:
        """Brightness temperature of frames, (n, rows, cols); see `fieldkit.sessions.analysis.kelvin`."""
        return analysis.kelvin(
            self._session, start, stop, stream=self.name, calibration=calibration, damaged=damaged
        )

    def region_series(
        self, regions: Sequence[Region] | None = None, *, calibration: Calibration | None = None
    ) -> RegionSeries:
        """Brightness temperature of regions over time; see `fieldkit.sessions.analysis.region_series`."""
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
        """The samples as a table by UTC; see `fieldkit.sessions.analysis.to_pandas`."""
        return analysis.to_pandas(self._session, self.name)

    def to_xarray(self) -> xr.Dataset:
        """The samples as a lazy xarray dataset; see `fieldkit.sessions.analysis.to_xarray`."""
        return analysis.to_xarray(self._session, self.name)


@checked
class Session(SessionReader):
    """One recording: its streams by name, slopes, maps, reports.

    A context manager; `close` releases its file, and so does the end of the program.

    Examples
    --------
    Streams by name, and their samples:

    >>> list(session.streams)
    ['camera', 'lux', 'thermometer']
    >>> session["camera"][0].counts.shape, session["lux"][-1].seq, len(session["thermometer"][:5])
    ((120, 160), 1199, 5)
    >>> session.readings("lux").values.shape, session.raw("camera").dtype
    ((1200, 1), dtype('uint16'))
    >>> sum(1 for sample in session.samples("lux", "thermometer"))
    2401
    >>> session.count("camera") == session.times_ns("camera").size == session.flags("camera").size
    True

    Slopes of every region, of every pixel, and those of the recording itself:

    >>> session.estimate()["b15"]
    <b15: tilt 15.1° (12.0 to 24.0), azimuth 181°, wide>
    >>> session.slope_map("all")
    <MappedSession 20160101T190001Z-noon: 20 min, 100% wide>
    >>> session.estimates()[-1].region, len(session.minutes()), len(session.learnt())
    ('b25', 21, 21)
    >>> session.irradiance()["irradiance_w_m2"].shape
    (21,)

    What happened while recording:

    >>> [event.kind.name for event in session.events()]
    ['START', 'STOP']
    >>> [stream.received for stream in session.health()[-1].streams]
    [60, 1200, 1201]
    >>> len(session.region_history()), session.region_changes()
    (4, [])
    >>> session.clock_checks()[0].source
    'system'
    >>> session.time_map(), session.marks()
    ([], {})

    What can be done with it:

    >>> session.check()
    <CheckedSession 20160101T190001Z-noon: 12 ok>
    >>> session.report().path.name
    '20160101T190001Z-noon.html'
    >>> len(session.export("csv").files)
    6
    >>> session.plot().get_ylabel()
    'brightness temperature, °C'

    A session that is still being recorded shows what was added since it was opened:

    >>> session.refresh()
    >>> session.close()
    """

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    def __getitem__(self, stream: str) -> Stream:
        """One stream; raises `SessionError` where there is none of that name."""
        return Stream(self, self.stream(stream).info)

    def estimate(
        self,
        settings: Mapping[str, Any] | None = None,
        /,
        *,
        model: Model | None = None,
        present: bool = False,
        regions: Sequence[Region] | None = None,
        without_marks: Collection[int | str] = (),
        **values: Any,
    ) -> Estimates:
        """Slopes minute by minute; see `fieldkit.estimate`."""
        from fieldkit.results.estimate import estimate

        chosen: Mapping[str, Any] = {"regions": regions, "without_marks": without_marks}
        return checked(estimate)(self, settings, model=model, present=present, **chosen, **values)

    def slope_map(
        self, window: Window = None, *, settings: Settings = (), present: bool = False
    ) -> MappedSession:
        """Tilt and azimuth of every pixel; see `fieldkit.slope_map`."""
        from fieldkit.results.slope_map import slope_map

        return checked(slope_map)(self, window, settings=settings, present=present)

    def report(self, out: str | Path | None = None) -> Report:
        """Write the report, one HTML page with figures; see `fieldkit.report`."""
        from fieldkit.results.report import report

        return checked(report)(self, out)

    def check(self) -> CheckedSession:
        """Check the recording; nothing is changed. See `fieldkit.check`."""
        from fieldkit.results.check import check

        return checked(check)(self)

    def export(
        self, to: str, folder: str | Path | None = None, *, stream: str | None = None, every: int = 1
    ) -> Export:
        """Write tables, images or a file for another program; see `fieldkit.export`."""
        from fieldkit.results.export import export

        return checked(export)(self, to, folder, stream=stream, every=every)

    def take_back(self, mark: int | str) -> None:
        """Take back a mark, by its number in `marks` or its text; its event stays in the file.

        From then on events, estimates, reports and exports omit it. Raises `ConfigError` where no mark or
        more than one is meant, `SessionError` where the session is not finished, `StorageError`.

        Examples
        --------
        >>> session.take_back("a gust")
        Traceback (most recent call last):
        ...
        fieldkit.model.errors.ConfigError: 'a gust': the session has no such mark
        """
        from fieldkit.results.marks import correct, withdrawal

        correct(self, withdrawal(self, mark))
        self._reopen()

    def edit_mark(
        self,
        mark: int | str,
        text: str | None = None,
        *,
        label: str | None = None,
        at: str | None = None,
        to: str | None = None,
    ) -> None:
        """Give a mark another text, label or time, all else as it is. Raises as `take_back`.

        Times are ISO 8601 or ``12:31`` at the site; with `at` alone the mark has no end any more.

        Examples
        --------
        >>> def note(minute):
        ...     fieldkit.mark("a gust", campaign)
        >>> with fieldkit.record(campaign, duration="3m", on_minute=note) as noted:
        ...     noted.edit_mark(1, "a cloud")
        ...     noted.marks()[1].text
        ...     noted.take_back("a cloud")
        ...     1 in noted.marks()
        'a cloud'
        False
        """
        from fieldkit.results.marks import correct, replacement

        correct(self, replacement(self, mark, text, label=label, at=at, to=to))
        self._reopen()

    def _reopen(self) -> None:
        """Open the file that has taken the place of the one that is open."""
        again = open_as(type(self), self.path)
        self.close()
        vars(self).update(vars(again))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the brightness temperature of each region over local time, in °C.

        Without a camera or regions, the readings of the first meter in their own unit. One stream:
        ``session["lux"].plot()``.
        """
        cameras = [name for name, info in self.streams.items() if info.is_camera and self.regions]
        meters = [name for name, info in self.streams.items() if not info.is_camera]
        if not cameras + meters:
            raise SessionError("no regions to plot", place=self.path, fix="draw them: " + Action.ADD_REGION())
        return self[(cameras + meters)[0]].plot(ax)

    def __repr__(self) -> str:
        if self.is_closed:
            return f"<Session {self.name}: closed>"
        counts = ", ".join(f"{self.count(name)} {name}" for name in self.streams)
        return f"<Session {self.name}: {self.state}, {self._when()}, {counts or 'no streams'}>"

    def _repr_html_(self) -> str | None:
        if self.is_closed:
            return None  # a notebook then shows its `repr`
        rows = [
            (name, info.model, info.quantity, info.unit, f"{self.count(name)}")
            for name, info in self.streams.items()
        ]
        columns = ("stream", "instrument", "quantity", "unit", "samples")
        return html.table_html(html.Table(columns, rows, f"{self.name}: {self.state}, {self._when()}"))

    def _when(self) -> str:
        if not self.start_ns:
            return "no samples"
        start = formatting.local_time(self.start_ns, self.site)
        minutes = (self.end_ns - self.start_ns) / 60e9
        return f"{start:%Y-%m-%d %H:%M} {formatting.zone_name(self.start_ns, self.site)}, {minutes:.0f} min"


def open_session(path: str | Path | BinaryFile) -> Session:
    """Open a session for reading: sealed, recovered, interrupted, or while it is being recorded.

    A file object, such as ``fsspec.open("s3://bucket/day.h5").open()``, is read where it is, and is not
    closed. Its session can be estimated, mapped and exported into a folder; what changes a session or writes
    beside it needs a file.

    Raises
    ------
    SessionError
        Where the path holds no session, one of another format, or one too damaged to read.

    Examples
    --------
    >>> with fieldkit.open_session(session.path) as opened:
    ...     opened.state, opened.count("camera")
    ('sealed', 60)
    """
    return open_as(Session, path)
