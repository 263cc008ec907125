"""Tables that are no text: the values and times that went in, whatever holds them."""

import gzip
from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import xlsxwriter

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.results.importing import ImportOptions, read_source
from tests.harness.next_steps import at

STAMPS = [datetime(2026, 5, 12, 10, minute) for minute in range(12)]
CELSIUS = [20.0 + 0.25 * minute for minute in range(12)]
LUX = [50_000.0 + 100 * minute for minute in range(12)]
FRAME = pd.DataFrame({"time": STAMPS, "bed [C]": CELSIUS, "light [lx]": LUX})
IN_UTC = ImportOptions(zone="UTC")


def days(stamp: datetime) -> float:
    """As a spreadsheet counts them: 1 is 1900-01-01, and 60 the day that 1900 did not have."""
    return (stamp - datetime(1899, 12, 30)) / timedelta(days=1)


def workbook(path, **sheets):
    with xlsxwriter.Workbook(path, {"default_date_format": "yyyy-mm-dd hh:mm:ss"}) as book:
        for name, rows in sheets.items():
            sheet = book.add_worksheet(name)
            for number, row in enumerate(rows):
                sheet.write_row(number, 0, row)
    return path


def rows(head=("time", "bed [C]", "light [lx]"), stamp=lambda stamp: [stamp], above=()):
    return [*above, head, *([*stamp(at), *values] for at, *values in zip(STAMPS, CELSIUS, LUX, strict=True))]


TWO = ("Date", "Time", "bed [C]", "light [lx]")
WORKBOOKS = {
    "plain": rows(),
    "title above": rows(above=[["Garden"], [], ["Logger", "MX2203"]]),
    "a free column before it": rows(("", "time", "bed [C]", "light [lx]"), lambda stamp: ["", stamp]),
    "text": rows(stamp=lambda stamp: [stamp.isoformat()]),
    "days as numbers": rows(stamp=lambda stamp: [days(stamp)]),
    "date and time": rows(TWO, lambda stamp: [stamp.date(), stamp.time()]),
    "date and time as numbers": rows(TWO, lambda stamp: [days(stamp) // 1, days(stamp) % 1]),
    "units in a line below": [["time", "bed", "light"], ["", "°C", "lx"], *rows()[1:]],
}


def assert_whole(path, options=IN_UTC):
    imported = read_source(path, options)
    values = {info.quantity: [s.values[0] for s in imported.samples if s.stream == info.name]
              for info in imported.streams}  # fmt: skip
    assert values["temperature"] == pytest.approx(np.array(CELSIUS) + 273.15)
    assert values["illuminance"] == pytest.approx(LUX)
    stamps = sorted({sample.time_ns for sample in imported.samples})
    assert stamps == [int(stamp.replace(tzinfo=UTC).timestamp()) * 10**9 for stamp in STAMPS]


def test_a_heading_over_several_columns_belongs_to_each_name_below_it(tmp_path):
    with xlsxwriter.Workbook(tmp_path / "a.xlsx", {"default_date_format": "yyyy-mm-dd hh:mm"}) as book:
        sheet = book.add_worksheet()
        sheet.merge_range(0, 0, 0, 2, "Garden 2026")
        sheet.merge_range(1, 1, 1, 2, "Beds")
        for number, row in enumerate([["time"], ["", "north [C]", "south [C]"]], start=1):
            sheet.write_row(number, 0, row)
        sheet.write(1, 1, "Beds")
        for number, (stamp, celsius) in enumerate(zip(STAMPS, CELSIUS, strict=True), start=3):
            sheet.write_row(number, 0, [stamp, celsius, f"{celsius + 1:.2f}".replace(".", ",")])
    imported = read_source(tmp_path / "a.xlsx", IN_UTC)
    (info,) = imported.streams
    assert info.channels == ("Beds north", "Beds south")
    assert [sample.values[1] for sample in imported.samples] == pytest.approx(np.array(CELSIUS) + 274.15)


@pytest.mark.parametrize("kind", WORKBOOKS)
def test_workbooks_are_read_as_their_cells_show_them(tmp_path, kind):
    assert_whole(workbook(tmp_path / "a.xlsx", Data=WORKBOOKS[kind], Notes=[["made by"], ["hand"]]))


def test_of_several_tables_the_sheet_is_asked_for(tmp_path):
    path = workbook(tmp_path / "a.xlsx", Empty=[], Data=rows(), Old=rows()[:4])
    with pytest.raises(ConfigError, check=at(path, Argument("sheet", "Data"))):
        read_source(path, IN_UTC)
    assert_whole(path, ImportOptions(zone="UTC", sheet="Data"))
    with pytest.raises(ConfigError, match="Data, Old", check=at(path)):
        read_source(path, ImportOptions(zone="UTC", sheet="New"))
    with pytest.raises(ConfigError, check=at(tmp_path / "b.xlsx")):
        read_source(workbook(tmp_path / "b.xlsx", Empty=[]), IN_UTC)


ODS = (
    '<office:document-content xmlns:office="urn:oasis:names:tc:opendocument:xmlns:office:1.0" '
    'xmlns:table="urn:oasis:names:tc:opendocument:xmlns:table:1.0" '
    'xmlns:text="urn:oasis:names:tc:opendocument:xmlns:text:1.0"><office:body><office:spreadsheet>'
    '<table:table table:name="A">{}</table:table></office:spreadsheet></office:body>'
    "</office:document-content>"
)


def ods_cell(cell) -> str:
    if isinstance(cell, datetime):
        attributes = f'office:value-type="date" office:date-value="{cell.isoformat()}"'
    elif isinstance(cell, float):
        attributes = f'office:value-type="float" office:value="{cell}"'
    else:
        attributes = 'office:value-type="string"'
    return f"<table:table-cell {attributes}><text:p>{cell}</text:p></table:table-cell>"


def ods(path):
    import zipfile

    table = "".join(f"<table:table-row>{''.join(map(ods_cell, row))}</table:table-row>" for row in rows())
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        file.writestr("content.xml", ODS.format(table))
        names = ("content.xml", "text/xml"), ("/", "application/vnd.oasis.opendocument.spreadsheet")
        parts = "".join(f'<m:file-entry m:full-path="{n}" m:media-type="{kind}"/>' for n, kind in names)
        xmlns = 'xmlns:m="urn:oasis:names:tc:opendocument:xmlns:manifest:1.0"'
        file.writestr("META-INF/manifest.xml", f"<m:manifest {xmlns}>{parts}</m:manifest>")
    return path


def netcdf(path, **encoding):
    names = FRAME.set_index("time").rename(columns={"bed [C]": "bed", "light [lx]": "light"})
    data = xr.Dataset.from_dataframe(names)
    data["bed"].attrs["units"], data["light"].attrs["units"] = "degC", "lx"
    data["profile"] = (("time", "z"), np.zeros((12, 3)))
    data.to_netcdf(path, **encoding)
    return path


def test_columns_of_programs_and_netcdf_by_cf_are_read(tmp_path):
    packed = {"dtype": "i2", "scale_factor": 0.25, "_FillValue": -999}
    zoned = {"units": "minutes since 2026-05-12 19:00 +09:00", "dtype": "i4"}
    FRAME.to_parquet(tmp_path / "a.parquet")
    FRAME.set_index("time").tz_localize("UTC").to_parquet(tmp_path / "b.parquet")
    FRAME.to_feather(tmp_path / "c.feather")
    (tmp_path / "d.csv.gz").write_bytes(gzip.compress(FRAME.to_csv(index=False).encode()))
    ods(tmp_path / "e.ods")
    for name in ("a.parquet", "c.feather", "d.csv.gz", "e.ods"):
        assert_whole(tmp_path / name)
    assert_whole(tmp_path / "b.parquet", ImportOptions())
    for path in (
        netcdf(tmp_path / "f.nc", engine="h5netcdf", encoding={"time": zoned}),
        netcdf(tmp_path / "g.cdf", engine="scipy", encoding={"bed": packed}),
    ):
        assert_whole(path, ImportOptions())
        assert any("profile" in text for _, text in read_source(path, ImportOptions()).notes)


def test_a_value_that_the_file_declares_missing_has_none(tmp_path):
    data = xr.Dataset(
        {"bed": ("time", np.array([20.0, np.nan, 21.0]), {"units": "degC"})}, {"time": STAMPS[:3]}
    )
    data.to_netcdf(
        tmp_path / "a.nc", engine="h5netcdf", encoding={"bed": {"dtype": "i2", "_FillValue": -999}}
    )
    values = [sample.values[0] for sample in read_source(tmp_path / "a.nc", ImportOptions()).samples]
    assert np.isnan(values).tolist() == [False, True, False]


@pytest.mark.parametrize("name", ["a.xlsx", "a.xls", "a.ods", "a.parquet", "a.feather", "a.nc", "a.csv.gz"])
def test_what_only_has_the_name_is_refused(tmp_path, name, capfd):
    for data in (b"", b"PK\3\4", b"\x1f\x8b\x08", b"PAR1" * 9, b"CDF\1" + bytes(40)):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ConfigError, check=at(tmp_path / name)):
            read_source(tmp_path / name, IN_UTC)
    assert capfd.readouterr().err == ""
