"""Libraries of native code, which write into standard error themselves what is wrong with a file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from fieldkit.model.arrays import AnyArray


def decode_image(data: bytes) -> AnyArray | None:
    """The pixels as they are stored, (rows, cols) or (rows, cols, channels); None if they do not decode."""
    import cv2

    with quiet():
        try:
            return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # larger than OpenCV allows, or nothing at all
            return None


@contextmanager
def quiet() -> Iterator[None]:
    """Without standard error of the process."""
    before = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)
