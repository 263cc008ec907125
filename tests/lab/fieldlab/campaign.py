"""A campaign folder for the guest: the field's site and beds, and the instruments by their identities."""

from __future__ import annotations

from collections.abc import Mapping

from fieldkit.model.site import RegionKind
from fieldkit.simulation import Scene

CAMERA = {"driver": "purethermal", "identity": "1e4e:0100"}
SECOND_CAMERA = {"driver": "p2pro", "identity": "0bda:5830"}
LUX = {"driver": "lutron", "identity": "0403:6001:LUX0001", "every_s": 0.5}
THERMOMETER = {"driver": "center-309", "identity": "0403:6001:TMP0001", "every_s": 1.0}
ALL = {"camera": CAMERA, "lux": LUX, "thermometer": THERMOMETER}
CAMERA_BY_ID = "/dev/v4l/by-id/usb-GroupGets_PureThermal__fw:v1.3.0__8007000b-5113-3037-3231-video-index0"
SECOND_BY_ID = "/dev/v4l/by-id/usb-Generic_USB_Camera-video-index0"
LUX_BY_ID, THERMOMETER_BY_ID = (
    f"/dev/serial/by-id/usb-QEMU_QEMU_USB_SERIAL_{serial}-if00-port0" for serial in ("LUX0001", "TMP0001")
)
SETTINGS = """
[record]
sampling = "all"

[estimator]
azimuth = "known"
min_minutes = 2
"""


def toml(scene: Scene, devices: Mapping[str, Mapping[str, object]] = ALL) -> str:
    """``fieldkit.toml`` for these instruments, by the names of their tables."""
    site = scene.site
    place = {
        "latitude_deg": site.latitude_deg,
        "longitude_deg": site.longitude_deg,
        "elevation_m": site.elevation_m,
    }
    tables = [_table("site", place), SETTINGS]
    tables += [_table(name, values) for name, values in devices.items()]
    for region in scene.regions:
        kind = "reference" if region.kind is RegionKind.REFERENCE else "target"
        points = [list(map(float, point)) for point in region.points_px]
        slope = {"tilt_deg": region.tilt_deg, "azimuth_deg": region.azimuth_deg}
        tables.append(_table("[region]", {"name": region.name, "kind": kind, "points_px": points, **slope}))
    return "\n".join(tables)


def _table(name: str, values: Mapping[str, object]) -> str:
    lines = (f"{key} = {_value(value)}" for key, value in values.items())
    return f"[{name}]\n" + "\n".join(lines) + "\n"


def _value(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)
