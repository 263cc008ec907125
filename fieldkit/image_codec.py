"""Images of files, decoded by OpenCV without a line of its own."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from fieldkit.model.arrays import AnyArray


def decode(data: bytes) -> AnyArray | None:
    """The pixels as they are stored, (rows, cols) or (rows, cols, channels); None if they do not decode."""
    import cv2

    with _quiet():
        try:
            return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # larger than OpenCV allows, or nothing at all
            return None


@contextmanager
def _quiet() -> Iterator[None]:
    """Without standard error of the process: libpng and libtiff write there themselves what is wrong."""
    before = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)
