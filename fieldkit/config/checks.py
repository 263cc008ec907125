"""What no single key can tell: mistakes between the keys of a configuration.

The checks read the plain document and pass over whatever is malformed (the models tell that),
so that one mistake does not hide another.
"""

from __future__ import annotations

import functools
import zoneinfo
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from fieldkit.config.lines import Path
from fieldkit.config.mistakes import Mistake
from fieldkit.drivers import registry
from fieldkit.model.site import Region, RegionKind

INSTRUMENTS = ("camera", "lux", "thermometer")
"""The tables of instruments that have a name of their own."""


def cross_check(document: Mapping[str, Any]) -> list[Mistake]:
    """Mistakes between keys: time zone, names, the reference, regions off the picture, halves of pairs."""
    checks = (_timezone, _device_names, _region_names, _reference, _off_the_picture, _irradiance, _half_pairs)
    return [mistake for check in checks for mistake in check(document)]


def unknown_drivers(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Drivers that are not installed here; a session from elsewhere may name them, a campaign may not."""
    others = _table(document, "device")
    tables: list[tuple[Path, Mapping[str, Any]]] = [((name,), _table(document, name)) for name in INSTRUMENTS]
    tables += [(("device", name), _table(others, name)) for name in others]
    for path, table in tables:
        name = table.get("driver")
        if not isinstance(name, str) or name in registry.BUILT_IN or name in (known := registry.names()):
            continue
        near = get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
        yield Mistake((*path, "driver"), f"no driver is called {name!r}; {hint}")


def crossed_outlines(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Regions whose outline crosses itself; a session may have been recorded with one, none is begun."""
    for path, region in _regions(document):
        corners = outline(region.get("points_px"))
        if corners and Region("", RegionKind.TARGET, tuple(corners)).crosses_itself:
            said = "the outline crosses itself; give the corners in their order around the region"
            yield Mistake((*path, "points_px"), said)


def outline(points: Any) -> list[tuple[float, float]] | None:
    """The corners of a region as pairs, or None if they are not at least three pairs of numbers."""
    if not isinstance(points, list) or len(points) < 3:
        return None
    if not all(isinstance(point, list) and len(point) == 2 for point in points):
        return None
    if not all(isinstance(value, int | float) for point in points for value in point):
        return None
    return [(float(x), float(y)) for x, y in points]


def _timezone(document: Mapping[str, Any]) -> Iterator[Mistake]:
    name = _table(document, "site").get("timezone")
    if not isinstance(name, str) or name in (known := _timezones()):
        return
    near = get_close_matches(name, known, n=1)
    said = f"there is no time zone {name!r}" + (f"; did you mean {near[0]}?" if near else "")
    yield Mistake(("site", "timezone"), f"{said} (IANA names, such as Asia/Tokyo)")


@functools.cache
def _timezones() -> set[str]:
    return zoneinfo.available_timezones()


def _device_names(document: Mapping[str, Any]) -> Iterator[Mistake]:
    for name in _table(document, "device"):
        if name in INSTRUMENTS:
            yield Mistake(("device", name), f"this name belongs to the table [{name}]; choose another")


def _region_names(document: Mapping[str, Any]) -> Iterator[Mistake]:
    seen: dict[str, str] = {}
    for path, region in _regions(document):
        name = region.get("name")
        if not isinstance(name, str):
            continue
        if name.casefold() in seen:
            yield Mistake((*path, "name"), f"two regions are called {seen[name.casefold()]!r}")
        seen.setdefault(name.casefold(), name)


def _reference(document: Mapping[str, Any]) -> Iterator[Mistake]:
    regions = _regions(document)
    if regions and not any(region.get("kind") == "reference" for _, region in regions):
        yield Mistake(("region",), 'no reference among the regions; give the flat bed kind = "reference"')


def _off_the_picture(document: Mapping[str, Any]) -> Iterator[Mistake]:
    camera = _table(document, "camera")
    width, height = camera.get("width_px"), camera.get("height_px")
    if not isinstance(width, int) or not isinstance(height, int):
        return
    for path, region in _regions(document):
        for x, y in outline(region.get("points_px")) or ():
            if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
                where = f"corner ({x:g}, {y:g}) is outside the picture of {width} x {height} pixels"
                yield Mistake((*path, "points_px"), where)
                break


def _irradiance(document: Mapping[str, Any]) -> Iterator[Mistake]:
    table = _table(document, "irradiance")
    if table.get("model") == "calibrated" and "factor" not in table:
        yield Mistake(("irradiance", "model"), 'model = "calibrated" needs irradiance.factor')
    mounting, plane = table.get("mounting", "horizontal"), ("plane_tilt_deg", "plane_azimuth_deg")
    if mounting == "in-plane" and not set(plane) <= table.keys():
        yield Mistake(("irradiance", "mounting"), f'mounting = "in-plane" needs {" and ".join(plane)}')
    if mounting == "horizontal" and "gti" in _table(table, "measures").values():
        said = f'gti needs mounting = "in-plane" with {" and ".join(plane)}, or "sun-pointing"'
        yield Mistake(("irradiance", "measures"), said)


def _half_pairs(document: Mapping[str, Any]) -> Iterator[Mistake]:
    camera = _table(document, "camera")
    if ("width_px" in camera) != ("height_px" in camera):
        yield Mistake(("camera",), "width_px and height_px belong together")
    for path, region in _regions(document):
        tilt = region.get("tilt_deg")
        if isinstance(tilt, int | float) and tilt > 0 and "azimuth_deg" not in region:
            yield Mistake((*path, "tilt_deg"), "a tilted bed also needs azimuth_deg")


def _table(document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = document.get(name)
    return table if isinstance(table, dict) else {}


def _regions(document: Mapping[str, Any]) -> list[tuple[Path, Mapping[str, Any]]]:
    regions = document.get("region")
    if not isinstance(regions, list):
        return []
    return [(("region", index), region) for index, region in enumerate(regions) if isinstance(region, dict)]
