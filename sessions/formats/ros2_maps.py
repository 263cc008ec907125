"""Layers on the ground as ROS 2 messages in one MCAP file: a grid map, and an occupancy grid of a risk.

No ROS is needed to write it; ``ros2 bag play``, rviz and Foxglove read it. The x axis of the messages is
east, y north. Needs ``fieldkit[terrain]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldkit.physics.camera_geometry import Heights
from fieldkit.sessions.formats.ros2 import definition, header, ros2_writer, time

_GRID_MAP = {
    "": "std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
    "std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index",
    "grid_map_msgs/GridMapInfo": "float64 resolution\nfloat64 length_x\nfloat64 length_y\n"
    "geometry_msgs/Pose pose",
    "std_msgs/Float32MultiArray": "std_msgs/MultiArrayLayout layout\nfloat32[] data",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
}
_OCCUPANCY_GRID = {
    "": "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data",
    "nav_msgs/MapMetaData": "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\n"
    "uint32 height\ngeometry_msgs/Pose origin",
}
UNKNOWN = -1


def write_maps(
    path: Path,
    layers: Mapping[str, NDArray[np.float32]],
    ground: Heights,
    time_ns: int,
    *,
    risk: str | None = None,
    frame_id: str = "map",
) -> None:
    """Write layers as ``/grid_map``, and one of them as ``/occupancy_grid``. Raises `OSError`.

    Parameters
    ----------
    path
        The file.
    layers
        Values on the cells of the ground by name, rows from north to south; NaN is unknown.
    ground
        Cells and their heights, which become the layer ``elevation``.
    time_ns
        Stamp of the messages, UTC nanoseconds since 1970.
    risk
        Name of a layer in [0, 1] for the occupancy grid.
    frame_id
        Frame of the messages: its origin is that of the reference system.

    Raises
    ------
    ConfigError
        If the package that writes ROS 2 messages is not installed.
    """
    head = header(time_ns, frame_id)
    heights = {"elevation": ground.heights_m.astype(np.float32)}
    messages = [
        ("/grid_map", "grid_map_msgs/msg/GridMap", _GRID_MAP, _grid_map({**heights, **layers}, ground))
    ]
    if risk is not None:
        grid = _occupancy_grid(layers[risk], ground, time_ns)
        messages.append(("/occupancy_grid", "nav_msgs/msg/OccupancyGrid", _OCCUPANCY_GRID, grid))
    with path.open("wb") as file, ros2_writer(file) as writer:
        for topic, kind, parts, message in messages:
            schema = writer.register_msgdef(kind, definition(parts))
            writer.write_message(topic, schema, {"header": head, **message}, time_ns, time_ns)


def _pose(east_m: float, north_m: float) -> dict[str, Any]:
    return {
        "position": {"x": east_m, "y": north_m, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }


def _grid_map(layers: Mapping[str, NDArray[np.float32]], ground: Heights) -> dict[str, Any]:
    """Its first index runs from east to west, its second from north to south, the first one fastest."""
    rows, cols = ground.heights_m.shape
    length_x, length_y = cols * ground.cell_m, rows * ground.cell_m
    layout = {
        "dim": [
            {"label": "column_index", "size": rows, "stride": rows * cols},
            {"label": "row_index", "size": cols, "stride": cols},
        ],
        "data_offset": 0,
    }
    centre = _pose(ground.west_m + 0.5 * length_x, ground.north_m - 0.5 * length_y)
    return {
        "info": {"resolution": ground.cell_m, "length_x": length_x, "length_y": length_y, "pose": centre},
        "layers": list(layers), "basic_layers": [],
        "data": [
            {"layout": layout, "data": values[:, ::-1].ravel().tolist()} for values in layers.values()
        ],
        "outer_start_index": 0, "inner_start_index": 0,
    }  # fmt: skip


def _occupancy_grid(risk: NDArray[np.float32], ground: Heights, time_ns: int) -> dict[str, Any]:
    """From the south-western cell to the east, then northwards; percent."""
    rows, cols = risk.shape
    percent = np.where(np.isnan(risk), UNKNOWN, np.rint(100.0 * np.nan_to_num(risk)))
    info = {
        "map_load_time": time(time_ns), "resolution": ground.cell_m, "width": cols, "height": rows,
        "origin": _pose(ground.west_m, ground.north_m - rows * ground.cell_m),
    }  # fmt: skip
    return {"info": info, "data": percent[::-1].astype(int).ravel().tolist()}
