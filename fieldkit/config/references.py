"""References to calibration records: ``surface.emissivity = "@dry-silica-sand"``.

A reference is looked up in the campaign's ``calibration/`` folder and replaced by the record's value and
standard uncertainty; what was learnt of the sand brings a prior's standard deviations instead. The record
itself is kept under ``[calibration]`` of the configuration, so that a
session holds both value and origin and does not depend on the folder.
"""

from __future__ import annotations

import copy
import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from fieldkit.calibration.calibration_record import FOLDER, CalibrationRecord, as_document, find
from fieldkit.config.files import FILE_NAME, KeyPath, regions_in, table_in
from fieldkit.config.validation import Mistake
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Action
from fieldkit.model.text_file import read_text


class _Key(NamedTuple):
    """A key that takes references: the kind of record, the keys that it brings, and which of its `values`
    it takes; "" for the `value`, whose standard uncertainty it brings.
    """

    kind: str
    brings: tuple[KeyPath, ...]
    part: str = ""


KEYS: Mapping[KeyPath, _Key] = {
    ("surface", "emissivity"): _Key("emissivity", (("surface", "emissivity_sd"),)),
    ("irradiance", "factor"): _Key("irradiance", (("irradiance", "factor_sd"),)),
    ("estimator", "scale"): _Key("surface", (("estimator", "scale_sd"), ("prior", "gain_sd"))),
    ("slab", "conductivity_w_m_k"): _Key(
        "surface", (("slab", "conductivity_sd"), ("prior", "inertia_log_sd")), "conductivity_w_m_k"
    ),
    ("slab", "depth_m"): _Key("surface", (("prior", "depth_log_sd"), ("prior", "deep_share")), "depth_m"),
}
REGION_KEYS: Mapping[str, _Key] = {
    "emissivity": _Key("emissivity", (("region", "emissivity_sd"),)),
    "offset_k": _Key("uniformity", (("estimator", "offset_sd_k"),)),
}


TYPED = 'unknown key; fieldkit stores records here, refer to one: surface.emissivity = "@dry-silica-sand"'


def resolve(document: Mapping[str, Any], path: Path) -> tuple[dict[str, Any], list[Mistake]]:
    """The document with every reference replaced, and the mistakes of those that cannot be.

    `path` is the ``fieldkit.toml`` or the session that the document belongs to.
    """
    values = copy.deepcopy(dict(document))
    carried = values.pop("calibration", {})
    mistakes = [Mistake(("calibration", name), TYPED) for name in _handwritten_records(carried)]
    used = _still_used(values, {} if mistakes else carried)
    brought_by_others: dict[KeyPath, float] = {}
    for place, key in _places(values):
        place_value = _get(values, place)
        if not (isinstance(place_value, str) and place_value.startswith("@")):
            continue
        try:
            record, file = find(place_value[1:], calibration_folder(path), key.kind)
            value, document = _value(record, key), as_document(record)
            brings = _brought(document, key)
        except ConfigError as error:
            mistakes.append(Mistake(place, str(error.line)))
            continue
        _put(values, place, value)
        for brought, number in brings.items():
            # regions of several records share one uncertainty: that of the worst
            brought_by_others[brought] = max(number, brought_by_others.get(brought, number))
            _put(values, brought, brought_by_others[brought])
        used[_name(values, place)] = {"reference": place_value, "file": file.name, **document}
    if used:
        values["calibration"] = used
    return values, mistakes


def campaign_folder(path: Path) -> Path:
    """The folder of the campaign that a configuration or a session belongs to, or the one it lies in."""
    above = path.resolve().parents
    if path.name == FILE_NAME:
        return above[0]
    campaigns = (folder for folder in above if (folder / FILE_NAME).is_file() or (folder / FOLDER).is_dir())
    return next(campaigns, above[0])


def calibration_folder(path: Path) -> Path:
    """The ``calibration/`` folder of the campaign that a configuration or a session belongs to."""
    return campaign_folder(path) / FOLDER


def _value(record: CalibrationRecord, key: _Key) -> float:
    if record.kind != key.kind:
        what = f"a calibration of kind {record.kind}, not {key.kind}"
        raise ConfigError(what, place=f"@{record.name}")
    if not key.part:
        return float(record.value)
    if key.part in record.values:
        return float(record.values[key.part])
    if key.kind == "surface":
        raise ConfigError(
            f"has no value for {key.part}",
            place=f"@{record.name}",
            fix='learn it: estimator.model = "learned", then ' + Action.CALIBRATE("surface"),
        )
    what = f"has no value for region {key.part!r}; it has {', '.join(record.values)}"
    raise ConfigError(what, place=f"@{record.name}")


def _brought(record: Mapping[str, Any], key: _Key) -> dict[KeyPath, float]:
    """Values that a record, as a document, puts beside the key that names it.

    Raises `ConfigError` where they are not numbers.
    """
    learnt = record.get("details", {}).get("prior_sds", {})
    if not isinstance(learnt, dict) or not all(isinstance(number, float | int) for number in learnt.values()):
        what = "details.prior_sds is not a table of numbers"
        raise ConfigError(what, place=f"@{record['name']}", fix="calibrate again, and name the new record")
    uncertainty = record.get("standard_uncertainty")
    values = {place: learnt.get(".".join(map(str, place)), uncertainty) for place in key.brings}
    return {place: value for place, value in values.items() if value is not None}


def _places(values: Mapping[str, Any]) -> Iterator[tuple[KeyPath, _Key]]:
    """Every key that takes references."""
    yield from KEYS.items()
    for path, region in regions_in(values):
        for name, key in REGION_KEYS.items():
            ((table, sd),) = key.brings
            place = (*path, sd) if table == "region" else (table, sd)
            part = str(region.get("name", "")) if key.kind == "uniformity" else ""
            yield (*path, name), key._replace(brings=(place,), part=part)


def _handwritten_records(carried: Any) -> list[str]:
    """Entries of ``[calibration]`` that fieldkit did not write."""
    if not isinstance(carried, dict):
        return [""]
    return [name for name, record in carried.items() if not _is_document(record)]


def _is_document(record: Any) -> bool:
    tables = ("values", "details")
    return (
        isinstance(record, dict)
        and {"kind", "name"} <= record.keys()
        and all(isinstance(record.get(table, {}), dict) for table in tables)
    )


def _still_used(values: dict[str, Any], carried: Mapping[str, Any]) -> dict[str, Any]:
    """Records already in the document, except those whose value has been overridden.

    What a record that is not kept has brought is removed from `values` too.
    """
    by_name = {_name(values, place): (place, key) for place, key in _places(values)}
    entries = {name: (record, *by_name[name]) for name, record in carried.items() if name in by_name}
    active = {
        name: record
        for name, (record, place, key) in entries.items()
        if _get(values, place) == record.get("values", {}).get(key.part, record.get("value"))
    }
    in_use = {brought for name in active for brought in by_name[name][1].brings}
    for name, (record, _, key) in entries.items():
        for place, number in _brought(record, key).items():
            if name not in active and place not in in_use:
                _forget(values, place, number)
    return active


def _name(values: Mapping[str, Any], place: KeyPath) -> str:
    """A qualified key with regions by name: ``surface.emissivity``, ``b15.offset_k``."""
    if place[0] == "region":
        return f"{_get(values, (*place[:2], 'name'))}.{place[2]}"
    return ".".join(map(str, place))


def _get(values: Any, place: KeyPath) -> Any:
    for part in place:
        if isinstance(part, int):
            values = values[part]
        elif isinstance(values, dict):
            values = values.get(part)
        else:
            return None
    return values


def _forget(values: dict[str, Any], place: KeyPath, value: Any) -> None:
    """Remove a key if it has this value."""
    table = _get(values, place[:-1])
    if isinstance(table, dict) and value is not None and table.get(place[-1]) == value:
        del table[place[-1]]


def _put(values: dict[str, Any], place: KeyPath, value: float) -> None:
    table: Any = values
    for part in place[:-1]:
        table = table[part] if isinstance(part, int) else table.setdefault(part, {})
        if not isinstance(table, dict | list):
            return  # what stands in place of the table is the schema's mistake
    table[place[-1]] = value


COLUMNS = ["azimuth_deg", "elevation_deg"]


def load_horizon(path: Path) -> list[list[float]]:
    """The pairs (azimuth, elevation) of a CSV file, in degrees. Raises `ConfigError`."""
    rows = [row for row in csv.reader(read_text(path).splitlines()) if row]
    if not rows or [name.strip() for name in rows[0]] != COLUMNS:
        raise ConfigError(f"the first line must be {','.join(COLUMNS)}", place=path)
    pairs = [_pair(path, number, row) for number, row in enumerate(rows[1:], 2)]
    azimuths = [azimuth % 360.0 for azimuth, _ in pairs]
    if not pairs or len(set(azimuths)) < len(azimuths):
        what = "needs at least one row, and every azimuth once (0 and 360 are the same)"
        raise ConfigError(what, place=path)
    return pairs


def _pair(path: Path, number: int, row: list[str]) -> list[float]:
    try:
        azimuth, elevation = map(float, row)
    except ValueError:
        raise ConfigError(f"row {number}: write azimuth,elevation in degrees", place=path) from None
    if not (math.isfinite(azimuth) and 0.0 <= azimuth <= 360.0 and -90.0 < elevation < 90.0):
        raise ConfigError(f"row {number}: azimuth must be 0 to 360, elevation between -90 and 90", place=path)
    return [azimuth, elevation]


def with_horizons(values: dict[str, Any], path: Path) -> list[Mistake]:
    """Replace file names in `values` by their pairs; returns the mistakes."""
    mistakes = []
    for place, table in ((("site",), table_in(values, "site")), *regions_in(values)):
        if isinstance(name := table.get("horizon"), str):
            try:
                table["horizon"] = load_horizon(campaign_folder(path) / name)
            except ConfigError as error:
                mistakes.append(Mistake((*place, "horizon"), error.message))
    return mistakes
