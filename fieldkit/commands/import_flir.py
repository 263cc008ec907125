"""FLIR files (FFF, SEQ, radiometric JPEG) for ``fieldkit import``, read by the driver's decoder."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fieldkit.device import StreamInfo
from fieldkit.drivers.cameras import flir_file
from fieldkit.drivers.cameras.flir_file import FlirPicture
from fieldkit.errors import ConfigError, DecodeError
from fieldkit.samples import Frame, Severity
from fieldkit.sessions.exchange.imported import Foreign, flag_bunched


def read_flir(path: Path, name: str) -> Foreign:
    """The pictures of a file as a camera stream; counts and constants as stored.

    It is read twice, once for its stamps, and never kept whole. Raises `ConfigError` where the file
    is damaged, has no times, or changes its size or constants.
    """
    first, time_ns = _looked_through(path)
    flagged, remarks = flag_bunched(lambda: _frames(path, name), time_ns)
    info = StreamInfo(
        name, "brightness_temperature", "K", (first.counts.shape[0], first.counts.shape[1]), float("nan"),
        law="planck", rate_hz=first.rate_hz, driver="import", vendor="FLIR", model=first.model,
        serial_number=first.serial_number, settings=flir_file.settings(first),
    )  # fmt: skip
    said = "times are the camera's own clock; the emissivity set in the camera was not applied"
    return Foreign((info,), flagged, ((Severity.INFO, said), *remarks))


def _looked_through(path: Path) -> tuple[FlirPicture, list[int]]:
    """The first picture and the times of all, which must be like it."""
    first, time_ns = None, []
    for number, picture in enumerate(_pictures(path)):
        first = first or picture
        if picture.counts.shape != first.counts.shape or picture.constants != first.constants:
            raise ConfigError(
                f"{path}: picture {number} has another size or other constants than the first",
                fix="import its parts one by one",
            )
        if picture.time_ns <= 0:
            raise ConfigError(
                f"{path}: picture {number} does not say when it was taken",
                fix="export it as 16-bit TIFF, and import that with --times",
            )
        time_ns.append(picture.time_ns)
    if first is None:
        raise ConfigError(f"{path} has no pictures", fix="copy it from the camera again")
    return first, time_ns


def _frames(path: Path, name: str) -> Iterator[Frame]:
    rows = np.empty((0, 0), np.uint16)
    for number, picture in enumerate(_pictures(path)):
        yield Frame(name, picture.time_ns, picture.time_ns, picture.counts, rows, device_seq=number)


def _pictures(path: Path) -> Iterator[FlirPicture]:
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield from flir_file.pictures(data)
    except (DecodeError, OSError, ValueError) as error:  # ValueError: nothing to map
        if isinstance(error, ConfigError):
            raise
        fix = (
            getattr(error, "fix", None) or "copy it from the camera again; what was cut short cannot be read"
        )
        raise ConfigError(f"{path}: {error}", fix=fix) from error
