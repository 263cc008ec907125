"""Points with their properties as binary PLY, which CloudCompare, MeshLab and Open3D read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

TYPES = {"f4": "float", "f8": "double"}


def write_points(path: Path, columns: Mapping[str, NDArray[np.floating]], comment: str = "") -> None:
    """Write columns by property name, shape (n,) each, x, y and z among them, as points. Raises `OSError`.

    `comment` is a line for readers, such as the reference system.
    """
    kinds = [(name, f"<{values.dtype.str[1:]}") for name, values in columns.items()]
    points = np.empty(len(next(iter(columns.values()))), kinds)
    for name, values in columns.items():
        points[name] = values
    head = ["ply", "format binary_little_endian 1.0", f"comment {comment}", f"element vertex {len(points)}"]
    head += [f"property {TYPES[kind[1:]]} {name}" for name, kind in kinds]
    path.write_bytes("\n".join([*head, "end_header", ""]).encode("ascii") + points.tobytes())
