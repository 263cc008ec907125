"""FLIR files (FFF, SEQ, radiometric JPEG) for ``fieldkit import``, read by the driver's decoder."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from fieldkit.device import StreamInfo
from fieldkit.drivers.cameras import flir_file
from fieldkit.drivers.cameras.flir_file import FlirPicture
from fieldkit.errors import ConfigError, DecodeError
from fieldkit.samples import Frame, Severity
from fieldkit.sessions.exchange.imported import Foreign, flag_bunched

_COPY = "copy it from the camera again; what was cut short cannot be read"


def read_flir(path: Path, name: str) -> Foreign:
    """The pictures of a file as a camera stream; counts and constants as stored.

    It is read twice, once for its stamps, never kept whole, and taken as far as it is not damaged.
    Raises `ConfigError` where there is no whole picture, no time, or another size or other constants.
    """
    first, time_ns, damage = _looked_through(path)
    flagged, remarks = flag_bunched(lambda: islice(_frames(path, name), len(time_ns)), time_ns)
    if damage:
        remarks = ((Severity.WARNING, damage), *remarks)
    info = StreamInfo(
        name, "brightness_temperature", "K", (first.counts.shape[0], first.counts.shape[1]), float("nan"),
        law="planck", rate_hz=first.rate_hz, driver="import", vendor="FLIR", model=first.model,
        serial_number=first.serial_number, settings=flir_file.settings(first),
    )  # fmt: skip
    said = "times are the camera's own clock; the emissivity set in the camera was not applied"
    return Foreign((info,), flagged, ((Severity.INFO, said), *remarks))


def _looked_through(path: Path) -> tuple[FlirPicture, list[int], str]:
    """The first picture, the times of all, which must be like it, and what ended them before their end."""
    first, time_ns = None, []
    try:
        for number, picture in enumerate(_pictures(path)):
            first = first or picture
            _refuse_another(path, number, picture, first)
            time_ns.append(picture.time_ns)
    except DecodeError as error:
        if first is None:
            raise _no_picture(path, error) from error
        return first, time_ns, f"{error.message}: nothing after picture {len(time_ns)} could be taken"
    if first is None:
        raise ConfigError(f"{path} is empty", fix=_COPY)
    return first, time_ns, ""


def _refuse_another(path: Path, number: int, picture: FlirPicture, first: FlirPicture) -> None:
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


def _frames(path: Path, name: str) -> Iterator[Frame]:
    rows = np.empty((0, 0), np.uint16)
    for number, picture in enumerate(_pictures(path)):
        yield Frame(name, picture.time_ns, picture.time_ns, picture.counts, rows, device_seq=number)


def _pictures(path: Path) -> Iterator[FlirPicture]:
    """Raises `DecodeError` at the first picture that is none."""
    try:
        if path.stat().st_size == 0:  # which cannot be mapped
            return
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield from flir_file.pictures(data)
    except OSError as error:
        raise ConfigError(f"{path}: {error}", fix=_COPY) from error


def _no_picture(path: Path, error: DecodeError) -> ConfigError:
    return ConfigError(f"{path}: {error.message}", fix=error.fix or _COPY)
