"""Open an instrument by hand, read physical values, close it.

    with open_device("purethermal") as camera:
        frame = camera.read()
        print(frame.kelvin.mean())

The recorder bypasses this module: it stores counts, and the reader of a session applies the scale. Here each
sample is paired with its stream, so that it can give kelvin, or values by channel, by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar, cast

from fieldkit.drivers import registry
from fieldkit.drivers.discovery import ConnectedDevice, find_devices
from fieldkit.model.clock import Clock, HostClock
from fieldkit.model.device import Camera, Device, DeviceSettings, StreamInfo
from fieldkit.model.errors import ConfigError, DeviceNotFoundError, DeviceTimeoutError
from fieldkit.model.limits import bounds_of, flag_implausible
from fieldkit.model.next_step import Argument
from fieldkit.model.samples import Frame, Quality, Reading, is_usable
from fieldkit.physics.camera_laws import frame_k

if TYPE_CHECKING:
    from fieldkit.model.arrays import CountArray, FloatArray

TIMEOUT_S = 5.0


S = TypeVar("S", Frame, Reading)


@dataclass(frozen=True, slots=True, repr=False)
class _Measured(Generic[S]):
    """A sample and the stream that it is of."""

    sample: S
    info: StreamInfo

    @property
    def quality(self) -> Quality:
        """Reasons to trust the sample less."""
        return self.sample.quality

    @property
    def is_usable(self) -> bool:
        """True if it may enter a result: no shutter correction, saturation, repetition, impossible value."""
        return is_usable(self.sample.quality) and Quality.IMPLAUSIBLE not in self.sample.quality

    @property
    def time(self) -> datetime:
        """When the frame was taken, or the first byte of the reading was on the wire, UTC."""
        return datetime.fromtimestamp(self.sample.time_ns / 1e9, UTC)

    def _described(self, what: str, content: str) -> str:
        stamp = f"{self.time:%Y-%m-%d %H:%M:%S}.{self.time.microsecond // 1000:03d} UTC"
        flags = ", ".join(flag.name.lower() for flag in self.quality if flag.name) or "good"
        return f"<{what} of {self.info.name}: {content}, {stamp}, {flags}>"


class MeasuredFrame(_Measured[Frame]):
    """One frame of a camera and the stream that defines its scale."""

    @property
    def kelvin(self) -> FloatArray:
        """Brightness temperature of each pixel for emissivity 1, in kelvin, float64, shape (rows, cols).

        NaN where the camera's scale is unknown; `quality` then has `NO_VALUE`.
        """
        return frame_k(self.info, self.sample.counts, self.sample.metadata_rows)

    @property
    def counts(self) -> CountArray:
        """The pixels as the camera sent them, shape (rows, cols)."""
        return self.sample.counts

    def __repr__(self) -> str:
        rows, columns = self.counts.shape
        return self._described("frame", f"{columns}x{rows}")


class MeasuredReading(_Measured[Reading]):
    """One reading of a meter and the stream that names its channels and their unit."""

    @property
    def value(self) -> float:
        """The value of a meter with one channel, in `unit`; NaN where it shows none.

        Raises
        ------
        ValueError
            If the meter has several channels; `values` has them by name.
        """
        if len(self.sample.values) != 1:
            channels = ", ".join(self.info.channels)
            raise ValueError(f"{self.info.name} has several channels ({channels}): use .values[name]")
        return self.sample.values[0]

    @property
    def values(self) -> dict[str, float]:
        """The value of each channel, in `unit`; NaN where it shows none."""
        return dict(zip(self.info.channels, self.sample.values, strict=True))

    @property
    def unit(self) -> str:
        """Unit of the values: K, lx, W m-2."""
        return self.info.unit

    def __repr__(self) -> str:
        values = (f"{name} {value:.6g} {self.unit}" for name, value in self.values.items())
        return self._described("reading", ", ".join(values))


M = TypeVar("M", bound=MeasuredFrame | MeasuredReading, covariant=True)


class Instrument(Generic[M]):
    """An opened device that gives physical values; a context manager, and iterable."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self._bounds = bounds_of(device.info)

    @property
    def info(self) -> StreamInfo:
        """Declaration of the device: quantity, unit, shape, serial number."""
        return self.device.info

    def read(self, timeout_s: float = TIMEOUT_S) -> M:
        """The next frame (`MeasuredFrame`) of a camera, or reading (`MeasuredReading`) of a meter.

        Raises
        ------
        DeviceTimeoutError
            If none came within `timeout_s`.
        DeviceLostError
            If the instrument was unplugged.
        """
        sample = self.device.read(timeout_s)
        if sample is None:
            raise DeviceTimeoutError(
                f"no sample from {self.info.port} within {timeout_s:g} s",
                place=self.info.name,
                fix="check that it is switched on; a larger timeout_s waits longer",
            )
        if isinstance(sample, Frame):
            return cast(M, MeasuredFrame(sample, self.info))
        return cast(M, MeasuredReading(flag_implausible(sample, self._bounds), self.info))

    def run_shutter(self) -> bool:
        """Start the shutter correction of a camera; False if it has none that can be started."""
        return isinstance(self.device, Camera) and self.device.run_shutter()

    def close(self) -> None:
        """Release the instrument; a second call does nothing."""
        self.device.close()

    def __iter__(self) -> Iterator[M]:
        """Samples as they arrive; raises as `read` does."""
        while True:
            yield self.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        info = self.info
        size = "x".join(str(side) for side in reversed(info.shape))
        what = info.model or info.name
        return f"<{what} at {info.port}: {info.quantity} [{info.unit}], {size}>"


def open_device(
    driver: str | ConnectedDevice = "",
    *,
    identity: str = "",
    port: str = "",
    every_s: float = 1.0,
    clock: Clock | None = None,
    **options: Any,
) -> Instrument[Any]:
    """Open a camera or a meter.

    Parameters
    ----------
    driver
        Name of the driver (``fieldkit devices`` lists them), or an element of `find_devices`.
        Empty for the only connected instrument that a driver recognises for certain.
    identity, port
        Which one, where several are connected: ``vendor:product[:serial]``, or the path of a port.
    every_s
        Polling interval of a meter that sends nothing by itself. [s]
    clock
        The clock that stamps samples; the computer's own by default.
    **options
        The driver's own options, as in ``fieldkit.toml``.

    Returns
    -------
    An `Instrument`: its `read` gives a `MeasuredFrame` of a camera, a `MeasuredReading` of a meter.

    Raises
    ------
    DeviceError
        If the instrument is missing, busy, silent or not the one the driver expects.
    ConfigError
        If the driver or one of its options does not exist.

    Examples
    --------
    >>> with fieldkit.open_device("lutron", port="light-meter") as meter:
    ...     reading = meter.read()
    >>> reading.value, reading.unit, reading.is_usable
    (638.0, 'lx', True)
    """
    if not driver:
        driver = _only_device()
    if isinstance(driver, ConnectedDevice):
        if len(driver.drivers) != 1:
            raise ConfigError(
                "choose a driver",
                place=repr(driver),
                fix='name one by its identity: open_device("lutron", identity="...")',
            )
        # an identity survives a replug, a port does not
        identity, port = driver.identity, "" if driver.identity else driver.port
        driver = driver.drivers[0]
    settings = DeviceSettings(driver, driver, port, identity, every_s, options)
    return Instrument(registry.open_device(settings, clock or HostClock()))


def _only_device() -> ConnectedDevice:
    certain = [device for device in find_devices() if len(device.drivers) == 1 and not device.note]
    if len(certain) != 1:
        names = ", ".join(map(repr, certain)) or "none"
        raise DeviceNotFoundError(
            f"not one recognised instrument; connected: {names}",
            place=Argument("driver"),
            fix='name it: open_device("purethermal"); fieldkit.find_devices() lists all',
        )
    return certain[0]
