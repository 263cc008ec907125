"""Synthetic terrain, recorded and mapped on the ground: the files in other programs, and the numbers."""

import json
import shutil
import subprocess

import numpy as np
import pytest
import rasterio
from mcap.reader import make_reader
from rosbags import typesys as rosbags_types

from benchmarks import ground_map


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """A campaign with 20 minutes before a DEM of 100 x 100 cells, mapped."""
    folder = tmp_path_factory.mktemp("ground") / "terrain"
    ground_map.record_terrain(folder, "20m", ground_map.dem(100, 0.6)).close()
    ground_map.write_map(folder)
    return folder


def test_the_crater_lies_where_it_is(campaign):
    found = ground_map.GroundMap.read(campaign / "ground.tif", 0.0)
    assert found.places_off_m() <= 0.5 * found.cell_m


def test_rasterio_and_gdal_see_the_reference_system_with_north_up(campaign):
    with rasterio.open(campaign / "ground.tif") as file:
        assert file.crs.to_epsg() == 32613
        assert file.transform.a == -file.transform.e > 0.0
        east, north = ground_map.CRATER_M
        assert file.bounds.left < east < file.bounds.right
        assert file.bounds.bottom < north < file.bounds.top
    if shutil.which("gdalinfo") is None:
        pytest.skip("gdalinfo is not installed (Debian: gdal-bin)")
    told = subprocess.run(
        ["gdalinfo", "-json", str(campaign / "ground.tif")], check=True, stdout=subprocess.PIPE
    )
    document = json.loads(told.stdout)
    assert 'ID["EPSG",32613]]' in document["coordinateSystem"]["wkt"]
    assert document["geoTransform"][2] == document["geoTransform"][4] == 0.0
    assert document["geoTransform"][5] < 0.0
    assert document["bands"][0]["description"] == "slope"


def test_a_strict_reader_of_ros_2_finds_the_same_slopes(campaign):
    """With ROS's own definitions of all types that it has."""
    store = rosbags_types.get_typestore(rosbags_types.Stores.ROS2_JAZZY)
    with (campaign / "ground.mcap").open("rb") as file:
        (schema, _, message), *_ = make_reader(file, validate_crcs=True).iter_messages(topics=["/grid_map"])
    stored = rosbags_types.get_types_from_msg(schema.data.decode(), schema.name)
    store.register({name: one for name, one in stored.items() if name not in store.fielddefs})
    grid = store.deserialize_cdr(message.data, schema.name)
    with rasterio.open(campaign / "ground.tif") as file:
        slope = file.read(1)
    found = grid.data[grid.layers.index("slope")].data
    assert np.sort(found[np.isfinite(found)]).tolist() == np.sort(slope[np.isfinite(slope)]).tolist()


@pytest.mark.slow
def test_slopes_and_heights_of_an_afternoon(tmp_path):
    """Three hours: the bounds hold the tilts; half a cell, a twentieth of the relief.

    The goal where a degree is worth 0.2 K is 1.0 degree; pixels as unlike as beds may be reach 1.9.
    """
    with ground_map.record_terrain(tmp_path / "terrain", "3h", ground_map.dem()) as session:
        times_ns = session.start_ns + np.arange(0, 180 * 60 * 10**9, ground_map.STEP_NS)
    results = ground_map.compare(tmp_path / "terrain", times_ns)

    def value(word: str) -> float:
        (result,) = [result for result in results if word in result.name]
        return result.value

    assert value("worth 0.2 K") <= 2.1
    assert value("90 % bounds") >= 88.0
    assert value("crater") <= 0.5
    assert value("heights") <= 5.0
