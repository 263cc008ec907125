"""FLIR files (FFF, SEQ, radiometric JPEG) for ``fieldkit import``, read by the driver's decoder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fieldkit.device import StreamInfo
from fieldkit.drivers.cameras import flir_file
from fieldkit.errors import ConfigError, DecodeError
from fieldkit.samples import Frame, Severity
from fieldkit.sessions.exchange.imported import Foreign, flag_bunched


def read_flir(path: Path, name: str) -> Foreign:
    """The pictures of a file as a camera stream; counts and constants as stored.

    Raises `ConfigError` where the file is damaged, has no times, or changes its size or constants.
    """
    try:
        pictures = list(flir_file.pictures(path.read_bytes()))
    except (DecodeError, OSError) as error:
        raise ConfigError(f"{path}: {error}", fix=getattr(error, "fix", None)) from error
    first = pictures[0]
    for number, picture in enumerate(pictures):
        if picture.counts.shape != first.counts.shape or picture.constants != first.constants:
            raise ConfigError(
                f"{path}: picture {number} has another size or other constants than the first",
                fix="import its parts one by one",
            )
        if picture.time_ns <= 0:
            raise ConfigError(f"{path}: picture {number} does not say when it was taken")
    rows = np.empty((0, 0), np.uint16)
    frames = [
        Frame(name, picture.time_ns, picture.time_ns, picture.counts, rows, device_seq=number)
        for number, picture in enumerate(pictures)
    ]
    flagged, remarks = flag_bunched(frames)
    info = StreamInfo(
        name, "brightness_temperature", "K", (first.counts.shape[0], first.counts.shape[1]), float("nan"),
        law="planck", rate_hz=first.rate_hz, driver="import", vendor="FLIR", model=first.model,
        serial_number=first.serial_number, settings=flir_file.settings(first),
    )  # fmt: skip
    said = "times are the camera's own clock; the emissivity set in the camera was not applied"
    return Foreign((info,), flagged, ((Severity.INFO, said), *remarks))
