"""Read back by rosbags, whose parser and CDR decoder share nothing with the writer."""

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags import typesys as rosbags_types

from fieldkit.physics.camera_geometry import Heights
from fieldkit.sessions.formats.ros2 import write_maps

TIME_NS = 1_780_000_000_123_456_789
SLOPE = np.array([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0]], np.float32)  # north-west is 1, south-east 6


@pytest.fixture
def messages(tmp_path):
    ground = Heights(100.0, 51.0, 0.5, np.zeros((2, 3)))
    write_maps(tmp_path / "a.mcap", {"slope": SLOPE, "p": SLOPE / 10}, ground, TIME_NS, risk="p")
    found = {}
    with (tmp_path / "a.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            store = rosbags_types.get_typestore(rosbags_types.Stores.ROS2_JAZZY)
            stored = rosbags_types.get_types_from_msg(schema.data.decode(), schema.name)
            for name, fields in stored.items():  # definitions that ROS has must be ROS's own
                if name in store.fielddefs:
                    assert fields[1] == store.fielddefs[name][1]
            store.register({name: one for name, one in stored.items() if name not in store.fielddefs})
            found[channel.topic] = store.deserialize_cdr(message.data, schema.name)
            assert message.log_time == TIME_NS
    return found


def test_grid_map_runs_from_the_north_eastern_corner(messages):
    grid = messages["/grid_map"]
    assert grid.header.frame_id == "map"
    assert (grid.header.stamp.sec, grid.header.stamp.nanosec) == divmod(TIME_NS, 10**9)
    assert grid.layers == ["elevation", "slope", "p"]
    assert (grid.info.resolution, grid.info.length_x, grid.info.length_y) == (0.5, 1.5, 1.0)
    assert (grid.info.pose.position.x, grid.info.pose.position.y) == (100.75, 50.5)
    slope = grid.data[1]
    assert [(one.label, one.size) for one in slope.layout.dim] == [("column_index", 2), ("row_index", 3)]
    # a grid map's cell (i, j) lies i cells west and j cells south of that corner, stored column by column
    assert slope.data == pytest.approx([3, 2, 1, 6, np.nan, 4], nan_ok=True)


def test_occupancy_grid_is_the_risk_in_percent_from_the_south_west(messages):
    grid = messages["/occupancy_grid"]
    assert (grid.info.width, grid.info.height) == (3, 2)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (100.0, 50.0)
    assert list(grid.data) == [40, -1, 60, 10, 20, 30]
