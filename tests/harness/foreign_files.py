"""Files of other programs in their public layouts, small, and a function of nothing but their arguments."""

from __future__ import annotations

import gzip
import io
import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
import pandas as pd
import tifffile
from imagecodecs import jpegls_encode

from fieldkit.sessions.formats.ros2 import _DEFINITIONS, definition, header, ros2_writer

FFF_CONSTANTS = {
    # offset in the camera information: value; the numbers of the README beside the recorded T420 frame
    0x20: 0.95, 0x24: 0.0, 0x28: 295.15, 0x2C: 292.15, 0x30: 293.15, 0x34: 1.0, 0x3C: 0.5, 0x58: 16125.788,
    0x5C: 1420.1, 0x60: 1.0, 0x70: 0.006569, 0x74: 0.01262, 0x78: -0.002276, 0x7C: -0.00667, 0x80: 1.9,
    0x30C: 0.0109034,
}  # fmt: skip
_FFF_HEADER, _FFF_ENTRY = 64, 32


def fff(
    counts: np.ndarray, seconds: int, milliseconds: int = 0,
    changed: Mapping[int, float] = MappingProxyType({}), packed: bytes = b"",
) -> bytes:  # fmt: skip
    """One FLIR FFF, little-endian: 64-byte header, two directory entries, camera information, raw picture.

    `packed` stands in place of the counts.

    Layout: ExifTool's FLIR.pm (FFF header and directory, CameraInfo, RawData).
    """
    information = bytearray(0x470)
    struct.pack_into("<H", information, 0, 2)
    for offset, value in {**FFF_CONSTANTS, **changed}.items():
        struct.pack_into("<f", information, offset, value)
    struct.pack_into("<i", information, 0x308, -5588)
    struct.pack_into("<II", information, 0x384, seconds, milliseconds)
    struct.pack_into("<H", information, 0x464, 9)
    information[0xD4:0xD8] = b"T420"
    rows, cols = counts.shape
    raw = struct.pack("<HHH", 2, cols, rows).ljust(32, b"\0") + (packed or counts.astype("<u2").tobytes())
    first = _FFF_HEADER + 2 * _FFF_ENTRY
    records = ((0x20, first, len(information)), (0x01, first + len(information), len(raw)))
    directory = b"".join(
        struct.pack("<HHIIII", kind, 0, 0, 0, offset, length).ljust(_FFF_ENTRY, b"\0")
        for kind, offset, length in records
    )
    header = b"FFF\0".ljust(0x14, b"\0") + struct.pack("<III", 101, _FFF_HEADER, len(records))
    return header.ljust(_FFF_HEADER, b"\0") + directory + bytes(information) + raw


def radiometric_jpeg(data: bytes, size: int = 700) -> bytes:
    """An FFF in APP1 segments "FLIR" of a JPEG, in parts of `size` bytes (ExifTool: part and last part)."""
    parts = [data[start : start + size] for start in range(0, len(data), size)]
    segments = [b"FLIR\0\x01" + bytes([number, len(parts) - 1]) + part for number, part in enumerate(parts)]
    body = b"".join(b"\xff\xe1" + struct.pack(">H", len(one) + 2) + one for one in segments)
    return b"\xff\xd8" + body + b"\xff\xda"


def irg(counts: np.ndarray, magic: bytes = b"\xba\xab", emissivity: float = 0.95) -> bytes:
    """One InfiRay picture: header of 128 bytes, picture of bytes, picture of 16-bit numbers.

    Layout: jelle737/Vevor-Thermal-Utilities README, jaseg/infiray_irg.
    """
    rows, cols = counts.shape
    size = struct.pack("<IHH", rows * cols, rows, cols)
    header = magic + struct.pack("<H", 128) + size
    header = header.ljust(0x1E, b"\0") + struct.pack("<I", round(emissivity * 1e4))
    preview = (counts >> 8).astype(np.uint8).tobytes()
    return header.ljust(126, b"\0") + b"\xac\xca" + preview + counts.astype("<u2").tobytes()


def purethermal(stamps_s: list[float], shape: tuple[int, int] = (4, 6), count: int = 29_500) -> bytes:
    """A recording of the PureThermal Y16 recorder, unpacked (its README; the file in shared/)."""
    header = json.dumps({"width": shape[1], "height": shape[0], "fps": 9.0}).encode()
    data = b"PTY16V1\n" + struct.pack("<I", len(header)) + header
    for number, stamp in enumerate(stamps_s):
        picture = np.full(shape, count + number, "<u2")
        data += struct.pack("<Qdq", number, stamp, round(stamp * 1000)) + picture.tobytes()
    return data


BSRN_MINUTES = [
    # day, minute, GHI, DNI, DHI, long wave down, °C, hPa
    (1, 0, 600, 800, 90, 350, 21.5, 1012),
    (1, 1, 600, -999, 90, 350, 21.5, 1012),
    (1, 2, 600, 802, 90, 350, 21.5, 1012),
]


def bsrn(
    minutes: Sequence[tuple[float, ...]] = BSRN_MINUTES, *, longwave_up: bool = False,
    month: str = " 6 2024", place: tuple[float, float, int] = (36.058, 140.126, 25),
) -> bytes:  # fmt: skip
    """A month of BSRN as GCOS-174 lays it out (fixed columns); at Tateno unless told another place."""
    north, east, metres = place[0] + 90.0, place[1] + 180.0, place[2]
    lines = [
        "*U0001", f" 16 {month}  1{'':20}", "        2        3        4        5       21       23",
        "*U0004", " -1 -1 -1", "  1  1", "Tateno", f"{'':20} {'':20}", f"{'':15} {'':50}",
        f"{north:8.3f}{east:8.3f}{metres:5} 47646", " -1 -1 -1", "    0  5  90  4",
        "*C0100",
    ]  # fmt: skip
    spread = f"{1.0:5.1f} {-999:4} {-999:4}"  # standard deviation, least and most, which nobody here reads
    for day, minute, ghi, dni, dhi, lwd, celsius, hectopascal in minutes:
        lines.append(f" {day:2.0f} {minute:4.0f}   {ghi:4.0f} {spread}   {dni:4.0f} {spread}")
        lines.append(
            f"           {dhi:4.0f} {spread}   {lwd:4.0f} {spread}    "
            f"{celsius:5.1f} {55.0:5.1f} {hectopascal:4.0f}"
        )
    if longwave_up:
        zeros = f"{0:4} {spread}"
        lines += ["*C0300"] + [
            f" {day:2.0f} {minute:4.0f}   {zeros}   {450 + minute:4.0f} {spread}   {zeros}"
            for day, minute, *_ in minutes
        ]
    return ("\n".join(lines) + "\n").encode("ascii")


def surfrad() -> bytes:
    """Three minutes of Alamosa as SURFRAD_README lays a daily file out."""
    values = [0.0] * 20
    values[0], values[2], values[3], values[4], values[7] = 500.0, 900.0, 50.0, 210.0, 380.0
    values[15], values[17], values[19] = -5.0, 1.5, 770.0
    pairs = " ".join(f"{value:.1f} 0" for value in values)
    rows = [f" 2016   1  1  1 19 {minute:2} 19.{minute:03}  61.0 {pairs}" for minute in range(3)]
    return ("\n".join([" Alamosa", "  37.70  105.92 2317 m version 1", *rows]) + "\n").encode()


def solrad() -> bytes:
    """Three minutes as README_SOLRAD lays a daily file out: fixed width, the second beam marked bad."""
    head = "Albuquerque\n  35.03796 -106.62211 1617 -7\n"
    rows = [
        f"2020 163  6 11 19 {minute:2} {19 + minute / 60:6.3f}  15.20 {1000.0 + minute:7.1f} 0 "
        f"{900.0 + minute:7.1f} {int(minute == 2)} {100.0 + minute:7.1f} 0 {200.0:7.1f} 0 {30.0:7.1f} 0"
        + 4
        * f" {1.0:9.3f}"
        for minute in (1, 2, 3)
    ]
    return (head + "\n".join(rows) + "\n").encode()


HOURS = [(hour, 20 * hour, 30 * hour, 5 * hour, 10 + hour / 4) for hour in range(8, 12)]
"""Hour, global, direct, diffuse irradiance, °C."""


def modelled_weather() -> dict[str, bytes]:
    """Four hours at 40 N, 105 W by each service, as their documentations lay files out."""
    epw = ["LOCATION,Place,-,USA,TMYx,1,40.0,-105.0,-7.0,1600.0", *["HEAD"] * 7]
    tmy3 = [
        '724666,"PLACE",CO,-7.0,40.0,-105.0,1600',
        "Date (MM/DD/YYYY),Time (HH:MM),GHI (W/m^2),"
        "DNI (W/m^2),DHI (W/m^2),Dry-bulb (C),Pressure (mbar),Wspd (m/s)",
    ]
    nsrdb = [
        "Source,Location ID,Latitude,Longitude,Time Zone,Elevation,Local Time Zone",
        "NSRDB,1,40.0,-105.0,-7,1600,-7",
        "Year,Month,Day,Hour,Minute,GHI,DNI,DHI,Temperature,Pressure,Wind Speed",
    ]
    pvgis = [
        "Latitude (decimal degrees):\t40.000",
        "Longitude (decimal degrees):\t-105.000",
        "Elevation (m):\t1600.0",
        "Radiation database:\tPVGIS-NSRDB",
        "",
        "Slope: 0 deg. ",
        "time,Gb(i),Gd(i),Gr(i),H_sun,T2m,WS10m,Int",
    ]
    cams = [
        "# Coding: utf-8",
        "# Latitude (positive North, ISO 19115): 40.0000",
        "# Longitude (positive East, ISO 19115): -105.0000",
        "# Altitude (m): 1600.00",
        "# Summarization (integration) period: 0 year 0 month 0 day 1 h 0 min 0 s",
        "#",
        "# Observation period;TOA;GHI;DHI;BNI",
    ]
    for hour, ghi, dni, dhi, celsius in HOURS:
        epw.append(f"2020,6,11,{hour},60,?9,{celsius},5,60,84000,0,0,300,{ghi},{dni},{dhi}" + 19 * ",2.5")
        tmy3.append(f"06/11/2020,{hour:02}:00,{ghi},{dni},{dhi},{celsius},840,2.5")
        nsrdb.append(f"2020,6,11,{hour - 1},30,{ghi},{dni},{dhi},{celsius},840,2.5")
        pvgis.append(f"20200611:{hour + 6:02}30,{ghi - dhi},{dhi},0.0,40.0,{celsius},2.5,0.0")
        period = f"2020-06-11T{hour + 6:02}:00:00.0/2020-06-11T{hour + 7:02}:00:00.0"
        cams.append(f"{period};900;{ghi};{dhi};{dni}")
    files = {"a.epw": epw, "tmy3.csv": tmy3, "nsrdb.csv": nsrdb, "pvgis.csv": [*pvgis, "", "T2m: air"]}
    return {name: ("\n".join(lines) + "\n").encode() for name, lines in {**files, "cams.csv": cams}.items()}


def obsdl() -> bytes:
    """Hourly values as JMA's help pages lay a download out: values, quality (8 normal), homogeneity."""
    text = (
        "ダウンロードした時刻：2024/10/13 09:28:46\r\n\r\n"
        ",つくば,つくば,つくば,つくば,つくば,つくば,つくば,つくば,つくば,つくば,つくば\r\n"
        "年月日時,気温(℃),気温(℃),気温(℃),日射量(MJ/㎡),日射量(MJ/㎡),日射量(MJ/㎡),"
        "風速(m/s),風速(m/s),風速(m/s),風速(m/s),風速(m/s)\r\n"
        ",,,,,,,,,風向,風向,\r\n"
        ",,品質情報,均質番号,,品質情報,均質番号,,品質情報,,品質情報,均質番号\r\n"
        "2024/6/1 11:00:00,21.5,8,1,3.60,8,1,2.5,8,北,8,1\r\n"
        "2024/6/1 12:00:00,22.0,8,1,2.88,4,1,3.0,8,北,8,1\r\n"
        "2024/6/2 0:00:00,,1,1,0.00,8,1,1.0,8,北,8,2\r\n"
    )
    return text.encode("cp932")


def radiation_table(rows: list[tuple[int, list[str], str]]) -> bytes:
    """A month as JMA describes it: heading of hours, days down and hours across, TOTAL and more below."""
    heading = "DAY" + "".join(f"{hour:5}" for hour in range(1, 25)) + "  TOTAL"
    days = [
        f"{day:3}" + "".join(f"{hour:>5}" for hour in hours) + f"{total:>6}" for day, hours, total in rows
    ]
    rule = "-" * 130
    text = ["DIRECT SOLAR RADIATION  TATENO  JUNE 2024", rule, heading, rule, *days, rule]
    return "\r\n".join([*text, "TOTAL" + "  100" * 25]).encode("cp932")


def tiff(value: int = 29_500) -> bytes:
    """A 16-bit picture of one value."""
    _, data = cv2.imencode(".tif", np.full((5, 7), value, np.uint16))
    return data.tobytes()


def tiff_pages(*pages: tuple[np.ndarray, dict[int, int]], order: str = "<", is_big: bool = False) -> bytes:
    """Uncompressed pages with further tags; TIFF 6.0, sections 2 and 4, or BigTIFF (places of 8 bytes)."""
    place, count, size = ("Q", "Q", 8) if is_big else ("I", "H", 4)
    data = {"<": b"II", ">": b"MM"}[order] + struct.pack(f"{order}H", 43 if is_big else 42)
    data += struct.pack(f"{order}HH", 8, 0) if is_big else b""
    after = len(data)  # where the place of the next directory is to be filled in
    data += bytes(size)
    for pixels, more in pages:
        kind = {"u": 1, "i": 2, "f": 3}[pixels.dtype.kind]
        tags = {
            256: pixels.shape[1], 257: pixels.shape[0], 258: 8 * pixels.itemsize, 259: 1, 262: 1,
            273: len(data), 277: 1 if pixels.ndim == 2 else pixels.shape[2], 278: pixels.shape[0],
            279: pixels.nbytes, 339: kind, **more,
        }  # fmt: skip
        data += pixels.astype(pixels.dtype.newbyteorder(order)).tobytes()
        data += bytes(len(data) % 2)
        data = data[:after] + struct.pack(order + place, len(data)) + data[after + size :]
        data += struct.pack(order + count, len(tags))
        for tag, value in sorted(tags.items()):
            short = tag not in (273, 279)
            packed = struct.pack(order + ("H" if short else "I"), value).ljust(size, b"\0")
            data += struct.pack(f"{order}HH{place}", tag, 3 if short else 4, 1) + packed
        after = len(data)
        data += bytes(size)
    return data


def frame_table() -> bytes:
    """A frame of 8 x 9 temperatures as FLIR's programs export it: preamble, label, decimal commas."""
    celsius = [[f"{20 + row * row + col / 10:.1f}".replace(".", ",") for col in range(9)] for row in range(8)]
    lines = [";".join(row) for row in celsius]
    return ("File:;a.jpg\nFrame 1;" + "\n;".join(lines) + "\n").encode()


def stack() -> bytes:
    """Three frames after one directory, as tifffile and ImageJ write them."""
    file, frames = io.BytesIO(), np.full((3, 5, 7), 29_500, np.uint16)
    tifffile.imwrite(file, frames, photometric="minisblack", metadata={"axes": "TYX"}, truncate=True)
    return file.getvalue()


def in_containers() -> dict[str, bytes]:
    """A table of a thermometer as a workbook, Parquet, Feather and netCDF of both kinds."""
    times = pd.date_range("2026-05-12T01:00", periods=20, freq="10s")
    table = pd.DataFrame({"time": times, "T1 [C]": np.linspace(20.0, 21.0, 20)})
    data = table.set_index("time").rename(columns={"T1 [C]": "T1"}).to_xarray()
    data["T1"].attrs["units"] = "degC"
    files = {name: io.BytesIO() for name in ("a.xlsx", "a.parquet", "a.feather")}
    with pd.ExcelWriter(files["a.xlsx"], engine="xlsxwriter") as book:
        table.to_excel(book, index=False)
    table.to_parquet(files["a.parquet"])
    table.to_feather(files["a.feather"])
    packed = {name: bytes(data.to_netcdf(None, engine=engine)) for name, engine in NETCDF.items()}
    return {name: file.getvalue() for name, file in files.items()} | packed


IN_UTC = ("--zone", "UTC")
NETCDF = {"a.nc": "h5netcdf", "a.cdf": "scipy"}


def ros2_mcap() -> bytes:
    """A thermometer and a camera of counts, as ROS 2 records them."""
    file = io.BytesIO()
    writer = ros2_writer(file)
    for kind, topic, fields in (
        ("sensor_msgs/msg/Temperature", "/air", {"temperature": 20.0, "variance": 0.0}),
        (
            "sensor_msgs/msg/Image",
            "/thermal",
            {"height": 5, "width": 7, "encoding": "mono16", "is_bigendian": 0, "step": 14, "data": bytes(70)},
        ),
    ):
        schema = writer.register_msgdef(kind, definition({"": _DEFINITIONS[kind]}))
        for second in range(5):
            at_ns = 1_780_000_000_000_000_000 + second * 10**9
            writer.write_message(topic, schema, {"header": header(at_ns, ""), **fields}, at_ns, at_ns)
    writer.finish()
    return file.getvalue()


def one_of_each(folder: Path) -> dict[Path, tuple[str, ...]]:
    """A sound file of every kind that import reads, and the options it takes beside ``--site``."""
    counts = np.arange(14_000, 14_035, dtype=np.uint16).reshape(5, 7)
    sequence = b"".join(fff(counts, 1_480_000_000, 111 * n) for n in range(3))
    moment = ("--time-format", "%Y%m%dT%H%M%S", "--zone", "UTC")
    hours = ["0"] * 10 + ["324", "XXX", "180"] + ["0"] * 11
    kinds: dict[str, tuple[bytes, tuple[str, ...]]] = {
        "a.raw.y16.gz": (gzip.compress(purethermal([1.7e9 + n / 9 for n in range(4)])), ()),
        "a.fff": (fff(counts, 1_480_000_000), ()),
        "a.seq": (sequence, ()),
        "a.jpg": (radiometric_jpeg(fff(counts, 1_480_000_000)), ()),
        "20260512T010000.irg": (irg(counts // 5), moment),
        "20260512T010001.tif": (tiff(), (*moment, "--kelvin-per-count", "0.01")),
        "log.csv": (b"time,T1 [C],T2 [C]\n2026-05-12T01:00:00Z,20.5,21\n2026-05-12T01:00:10Z,20.6,\n", ()),
        "slv16001.dat": (surfrad(), ()),
        "tat0624.dat": (bsrn(longwave_up=True, place=(37.7, -105.92, 2317)), ()),
        "obsdl.csv": (obsdl(), ()),
        "a.csq": (fff(counts, 1_480_000_000, packed=jpegls_encode(counts)), ()),
        "20260512T010002.csv": (frame_table(), (*moment, "--unit", "C")),
        "stack.tiff": (stack(), ("--times", str(folder / "stack-times.csv"), "--kelvin-per-count", "0.01")),
        "a.mcap": (ros2_mcap(), ("--kelvin-per-count", "0.01")),
        "abq20163.dat": (solrad(), ("--site", "35.038,-106.622,1617")),
        **{name: (data, ("--site", "40,-105,1600")) for name, data in modelled_weather().items()},
        **{
            name: (data, ("--zone", "UTC") if name not in NETCDF else ())
            for name, data in in_containers().items()
        },
        "DR202406_tat.txt": (radiation_table([(1, hours, "504]")]), ()),
    }
    seconds = [f"stack.tiff,2026-05-12T01:00:{second:02}Z\n" for second in range(3)]
    (folder / "stack-times.csv").write_text("".join(seconds))
    for name, (data, _) in kinds.items():
        (folder / name).write_bytes(data)
    return {folder / name: options for name, (_, options) in kinds.items()}
