"""Writing over fixed-size values of a closed session file without the HDF5 library.

Values stored contiguously lie at one place of the file and carry no checksum of the library's,
so they can be written like any bytes: one write each, which either fails or is done. Readers
that have the file open are not disturbed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray


def write_in_place(path: Path, values: Mapping[str, Any]) -> None:
    """Write each value over the dataset of that name, which must have its size, and sync.

    Raises `OSError` where the disk takes it not, `ValueError` where a value does not fit.
    """
    with h5py.File(path, "r", locking=False) as file:
        places = {name: _place(file[name], value) for name, value in values.items()}
    descriptor = os.open(path, os.O_WRONLY)
    try:
        for offset, data in places.values():
            if os.pwrite(descriptor, data, offset) < len(data):
                raise OSError(f"{path} took only a part of a value")
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _place(dataset: h5py.Dataset, value: Any) -> tuple[int, bytes]:
    data: NDArray[Any] = np.asarray(value, dataset.dtype)
    offset = dataset.id.get_offset()
    if data.shape != dataset.shape or offset is None:
        raise ValueError(
            f"{dataset.name} has shape {dataset.shape}, not {data.shape}, or no place of its own"
        )
    return offset, data.tobytes()
