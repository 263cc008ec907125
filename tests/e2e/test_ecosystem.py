"""A session opens in the tools people have: h5dump, ncdump, xarray with both engines, NeXus viewers, zarr.

What is exported of it passes the checkers of archives: CF, Frictionless. RO-Crate's required sentences are in
tests/unit/sessions/formats/test_ro_crate.py, COG in tests/unit/cli/test_map.py, MCAP's own reader in
tests/unit/sessions/formats/test_mcap.py.

Each engine bundles its own HDF5 library, so each runs in a process of its own.
"""

import json
import shutil
import subprocess
from typing import Any

import h5py
import pytest

import fieldkit
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.sessions.records import MinuteRecord
from fieldkit.sessions.writer import SessionWriter
from tests.harness.command_line import run_code
from tests.harness.recording import CountedClock, fill, header, picture

FRAMES = 30
OPEN = """
import json, sys, warnings
warnings.simplefilter("error")
import numpy as np
import xarray as xr
path, engine = sys.argv[1:]
options = {"engine": engine}
with xr.open_dataset(path, group="camera", **options) as camera:
    kelvin = camera["counts"]
    result = {"kelvin": kelvin.values[7, 3, 20:23].tolist(), "dims": dict(kelvin.sizes),
              "units": kelvin.units, "time": str(camera["time"].values[0]), "coords": sorted(camera.coords)}
with xr.open_dataset(path, group="thermometer", **options) as thermometer:
    result["channels"] = [str(np.asarray(x).astype(str)) for x in thermometer["label"].values]
    result["T2"] = float(thermometer["value"].values[3, 1])
with xr.open_dataset(path, group="estimates", **options) as estimates:
    result["tilt"] = estimates["tilt_deg"].values.tolist()
    result["region"] = estimates["region"].values.astype(str).tolist()
    result["phony"] = [name for name in estimates.dims if "phony" in name]
with xr.open_datatree(path, **options) as tree:
    result["groups"] = sorted(tree.children)
    result["phony"] += [d for node in tree.subtree for d in node.dims if "phony" in d]
print(json.dumps(result))
"""

NEXUS = """
import json, sys
import h5py
from nexusformat.nexus import nxload
from silx.io.nxdata import NXdata, get_default
with h5py.File(sys.argv[1]) as file:
    plot = get_default(file)
    groups = [node for node in file.values() if node.attrs["NX_class"] == b"NXdata"]
    result = {"silx": [plot.signal.shape, plot.axes_dataset_names],
              "valid": {node.name: NXdata(node).is_valid for node in groups}}
shown = nxload(sys.argv[1]).get_default()
result["nexusformat"] = [shown.nxsignal.shape, [axis.nxname for axis in shown.nxaxes]]
print(json.dumps(result))
"""

ZARR = """
import json, sys
import fsspec, h5py, zarr
from kerchunk.hdf import SingleHdf5ToZarr
references = SingleHdf5ToZarr(sys.argv[1]).translate()
system = fsspec.filesystem("reference", fo=references, asynchronous=True)
camera = zarr.open_group(zarr.storage.FsspecStore(system, read_only=True), mode="r")["camera"]
with h5py.File(sys.argv[1]) as file:
    same = {name: bool((camera[name][:] == file["camera"][name][:]).all()) for name in ("counts", "mono_ns")}
print(json.dumps({**same, "scale": camera["counts"].attrs["scale_factor"]}))
"""


FLAT = """
import sys
import netCDF4
path, folder = sys.argv[1:]
with netCDF4.Dataset(path) as source:
    source.set_auto_maskandscale(False)
    for name, group in source.groups.items():
        with netCDF4.Dataset(f"{folder}/{name}.nc", "w") as flat:
            flat.setncatts({**source.__dict__, **group.__dict__})
            for dimension in group.dimensions.values():
                flat.createDimension(dimension.name, len(dimension))
            for variable in group.variables.values():
                attributes = dict(variable.__dict__)
                fill = attributes.pop("_FillValue", None)
                kind = variable.dtype, variable.dimensions
                copy = flat.createVariable(variable.name, *kind, fill_value=fill)
                copy.set_auto_maskandscale(False)
                copy.setncatts(attributes)
                if variable.dtype != str:
                    copy[:] = variable[:]
"""

CF = """
import sys
from compliance_checker.runner import CheckSuite, ComplianceChecker
CheckSuite.load_all_available_checkers()
for path in sys.argv[1:]:
    ComplianceChecker.run_checker(
        path, ["cf:1.11"], 0, "normal", output_filename=path + ".json", output_format="json"
    )
"""

FRICTIONLESS = """
import json, sys
from frictionless import validate
print(json.dumps(validate(sys.argv[1]).flatten(["fieldName", "rowNumber"])))
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("ecosystem") / "field.h5"
    clock = CountedClock()
    writer = SessionWriter(path, header(), clock)
    fill(writer, FRAMES, clock)
    slope = SlopeEstimate(60_000_000_000, "b05", SlopeState.OK, 5.25, 180.5)
    writer.put(MinuteRecord(60_000_000_000, (slope,), 800.0, "eq10"))
    writer.close()
    return path


def output(script: str, *arguments: str) -> Any:
    return json.loads(run_code(script, *arguments))


def test_viewers_of_nexus_plot_the_camera(session):
    plot = [[FRAMES, 120, 160], ["time", "y", "x"]]
    groups = ("camera", "irradiance", "lux", "thermometer")
    expected = {
        "silx": plot,
        "nexusformat": plot,
        "valid": dict.fromkeys((f"/{name}" for name in groups), True),
    }
    assert output(NEXUS, str(session)) == expected


def test_zarr_reads_frames_as_they_lie(session):
    assert output(ZARR, str(session)) == {"counts": True, "mono_ns": True, "scale": 0.01}


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_xarray_reads_kelvin_and_times(session, engine):
    found = output(OPEN, str(session), engine)
    assert found["kelvin"] == pytest.approx((picture(7, (120, 160))[3, 20:23] * 0.01).tolist(), abs=1e-9)
    assert found["dims"] == {"time": FRAMES, "y": 120, "x": 160}
    assert found["units"] == "K"
    assert found["time"].startswith("2016-11-24T15:06:45.00")  # 1480000000 s and the counted clock's 5 s
    assert {"time", "x", "y"} <= set(found["coords"])
    assert found["channels"] == ["T1", "T2", "T3", "T4"]
    assert found["T2"] == 250.0 + 1 + 3 / 3
    assert (found["region"], found["tilt"]) == (["b05"], [5.25])
    assert found["phony"] == []
    assert {"camera", "lux", "thermometer", "events", "estimates", "entry"} <= set(found["groups"])


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (["ncdump", "-h"], ["ushort counts(time, y, x)", "scale_factor = 0.01", "group: events"]),
        (["h5dump", "-H"], ['DATASET "counts"', "H5T_STD_U16LE", '"NX_class"']),
        (["h5dump", "-p", "-H", "-d", "/camera/counts"], ["PREPROCESSING SHUFFLE", "DEFLATE { LEVEL 1 }"]),
    ],
)
def test_command_line_tools_read_it(session, command, expected):
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed (packages hdf5-tools, netcdf-bin)")
    done = subprocess.run([*command, str(session)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for words in expected:
        assert words in done.stdout


def test_file_is_of_the_old_kind_that_everything_reads(session):
    assert session.read_bytes()[8] == 3  # superblock version of HDF5 1.10
    allowed = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE}

    def look(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset):
            assert node.dtype.kind in "uifS", f"{name} has {node.dtype}"
            properties = node.id.get_create_plist()
            used = {properties.get_filter(n)[0] for n in range(properties.get_nfilters())}
            assert used <= allowed, f"{name} needs filters {used}"
        else:
            assert "NX_class" in node.attrs, f"{name} has no NeXus class"

    with h5py.File(session) as file:
        file.visititems(look)
        assert file.attrs["Conventions"] == b"CF-1.11"


def test_every_number_has_a_unit_and_every_flag_a_meaning(session):
    def look(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if not isinstance(node, h5py.Dataset) or node.dtype.kind not in "uif":
            return
        said = {"units", "flag_values", "flag_masks", "long_name"} & set(node.attrs)
        assert said, f"{name} says neither unit nor meaning"
        for kind in ("flag_values", "flag_masks"):
            if kind in node.attrs:
                assert len(node.attrs[kind]) == len(node.attrs["flag_meanings"].split())

    with h5py.File(session) as file:
        file.visititems(look)


def test_a_netcdf_export_has_no_error_by_the_checker_of_cf(session, tmp_path):
    """The checker looks at the root of a file only: each group is one of its own for it."""
    (path,) = fieldkit.export(session, "netcdf", tmp_path).files
    (tmp_path / "flat").mkdir()
    run_code(FLAT, path, tmp_path / "flat")
    flat = sorted((tmp_path / "flat").glob("*.nc"))
    assert len(flat) > 8
    run_code(CF, *flat)
    reports = [json.loads(path.with_name(f"{path.name}.json").read_text())["cf:1.11"] for path in flat]
    errors = [result["msgs"] for report in reports for result in report["high_priorities"]]
    assert len(errors) > len(flat)
    assert [messages for messages in errors if messages] == []


def test_exported_tables_are_valid_by_their_schema(session, tmp_path):
    fieldkit.export(session, "csv", tmp_path)
    package, lux = tmp_path / "datapackage.json", tmp_path / "field-lux.csv"
    assert output(FRICTIONLESS, str(package)) == []
    fields = json.loads(package.read_text())["resources"][1]["schema"]["fields"]
    assert {"name": "illuminance [lx]", "type": "number", "unit": "lx"} in fields
    rows = lux.read_text().splitlines()
    lux.write_text("\n".join([*rows, rows[-1].replace("Z,", "Z,bright", 1)]))  # what is no number is found
    assert output(FRICTIONLESS, str(package)) == [["illuminance [lx]", len(rows) + 1]]
