"""Validation of a configuration: every mistake as a sentence with its place, its key and what was expected.

Mistakes of single keys come from the pydantic models (`explain`), mistakes between keys from `cross_check`.
"""

from __future__ import annotations

import math
import re
import zoneinfo
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from types import MappingProxyType
from typing import Any, TypeGuard

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from fieldkit.config.files import KeyPath, regions_in, table_in
from fieldkit.config.toml_schema import describe_value, known_keys, node_at, resolve
from fieldkit.drivers import registry
from fieldkit.estimation.surface_kinds import SAND
from fieldkit.model.clock import YEARS
from fieldkit.model.errors import ConfigError
from fieldkit.model.light_meter import OF_DAYLIGHT
from fieldkit.model.next_step import Text
from fieldkit.model.quantities import LIMITS
from fieldkit.model.site import Region, RegionKind, known_zone
from fieldkit.model.spelling import did_you_mean, nearest
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.phrases import Words

UNITS: Mapping[str, tuple[str, Mapping[str, float]]] = {
    "": ("", {"%": 100.0}),
    "deg": ("degrees", {"radians": math.radians(1.0)}),
    "c": ("degrees Celsius", {"K": 1.0, "°F": 1.8}),
    "k": ("kelvin", {"mK": 1e3}),
    "k_min": ("kelvin per minute", {"K/h": 60.0}),
    "s": ("seconds", {"ms": 1e3, "minutes": 1.0 / 60.0, "hours": 1.0 / 3600.0}),
    "m": ("metres", {"cm": 1e2, "mm": 1e3, "km": 1e-3, "feet": 1.0 / 0.3048}),
    "m_s": ("metres per second", {"km/h": 3.6}),
    "px": ("pixels", {}),
    "lx": ("lux", {"klx": 1e-3}),
    "mb": ("megabytes", {"bytes": 1e6, "GB": 1e-3}),
    "lm_w": ("lumen per watt", {}),
    "w_m_k": ("watts per metre and kelvin", {"mW/(m K)": 1e3}),
    "w_m2": ("watts per square metre", {"kW/m²": 1e-3, "mW/cm²": 0.1}),
    "w_m2_k": ("watts per square metre and kelvin", {"mW/(m² K)": 1e3}),
    "w_m2_k_per_m_s": ("watts per square metre and kelvin, per metre per second", {}),
    "j_m3_k": ("joules per cubic metre and kelvin", {"MJ/(m³ K)": 1e-6, "kJ/(m³ K)": 1e-3}),
    "kg_m3": ("kilograms per cubic metre", {"g/cm³": 1e-3, "g/m³": 1e3}),
    "j_kg_k": ("joules per kilogram and kelvin", {"kJ/(kg K)": 1e-3}),
}
"""Units of keys by their suffixes: in words, and how many of other units that people write are one of it."""
ZEROS = {"K": CELSIUS_ZERO_K, "°F": 32.0}
"""Numbers of other units at zero of the key's."""
OTHER_UNITS = ("rad", "f", "ms", "min", "h", "cm", "mm", "km", "ft", "klx", "gb", "kj_kg_k", "percent")
"""Suffixes that are not accepted; the error message for such a key names the key in fieldkit's unit."""
_ENDS = (("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum"))


UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
"""Names that pydantic gives an unknown key of a model and of a dataclass."""
INSTRUMENTS = ("camera", "lux", "thermometer")
"""The tables of instruments that have a name of their own."""


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake in the configuration: `path` is the key, `message` describes the mistake."""

    path: KeyPath
    message: str

    @property
    def key(self) -> str:
        """The key as it would be typed: ``site.latitude_deg``, ``region[0].points_px``."""
        name = ""
        for part in self.path:
            name += f"[{part}]" if isinstance(part, int) else f".{part}" if name else part
        return name


class ConfigMistakesError(ConfigError):
    """All mistakes of a configuration; `mistakes` holds one line for each."""

    def __init__(self, mistakes: Iterable[tuple[str, Mistake]], *, fix: Text | None = None) -> None:
        self.causes = [
            ConfigError(mistake.message, place=f"{where}: {mistake.key}") for where, mistake in mistakes
        ]
        self.mistakes: tuple[str, ...] = tuple(cause.message for cause in self.causes)
        if len(self.causes) == 1:
            (cause,) = self.causes
            super().__init__(cause.problem, place=cause.place, fix=fix)
        else:
            count = f"{len(self.causes)} mistakes in the configuration"
            super().__init__("\n  ".join([count, *self.mistakes]), fix=fix)

    def __reduce__(self) -> tuple[Any, ...]:
        """As text: a worker process passes the error on."""
        return ConfigMistakesError.__new__, (ConfigMistakesError, *self.args), self.__dict__


def explain(error: ValidationError, values: Mapping[str, Any]) -> list[Mistake]:
    """The mistakes pydantic found in `values`, one per key, each with what was expected there.

    A misspelled key is one mistake, not two: the key it resolves to is not reported as missing as well.
    """
    details = {_path_in(values, detail): detail for detail in reversed(error.errors(include_url=False))}
    resolved = {(*path[:-1], _resolve_key(path)) for path in unknown_keys(error, values)}
    reported = [path for path in details if details[path]["type"] != "missing" or path not in resolved]
    return [Mistake(path, _message(details[path], path)) for path in reversed(reported)]


def unknown_keys(error: ValidationError, values: Mapping[str, Any]) -> list[KeyPath]:
    """The keys of `values` that pydantic does not know."""
    details = error.errors(include_url=False)
    return [_path_in(values, detail) for detail in details if detail["type"] in UNKNOWN_KEY]


def _path_in(values: Any, detail: ErrorDetails) -> KeyPath:
    """The place in the document, without the branches of a union that pydantic adds."""
    path: KeyPath = ()
    for part in detail["loc"]:
        try:
            values = values[part]
        except (KeyError, IndexError, TypeError):
            return (*path, part) if detail["type"] == "missing" else path
        path += (part,)
    return path


def _message(detail: ErrorDetails, path: KeyPath) -> str:
    if detail["type"] in UNKNOWN_KEY:
        return _unknown_key_message(path)
    if path[::2] == ("region", "name"):
        return Words("error.region_name")
    if detail["type"] == "missing":
        return f"missing; expected {describe_value(node_at(path))}"
    return _unlike(path, detail["input"])


def _unknown_key_message(path: KeyPath) -> str:
    typed, resolved = str(path[-1]), _resolve_key(path)
    if resolved is None and (qualified := _qualified_key(path)):
        return f"unknown key; did you mean {qualified}?"
    if resolved is None:
        return f"unknown key; known here: {', '.join(known_keys(path[:-1]))}"
    stem = _without_unit(resolved)
    other_unit = stem == _without_unit(typed) and stem != resolved
    return f"unknown key; did you mean {resolved}" + (
        f", in {UNITS[resolved[len(stem) + 1 :]][0]}?" if other_unit else "?"
    )


def _resolve_key(path: KeyPath) -> str | None:
    """The known key closest to an unknown one: the same in fieldkit's unit, or one spelled alike."""
    typed, names = str(path[-1]).lower(), known_keys(path[:-1])
    same = [key for key in names if _without_unit(key) == _without_unit(typed)]
    return same[0] if same else nearest(typed, names)


def _qualified_key(path: KeyPath) -> str | None:
    """The key with its table: ``surface.albedo`` for ``albedo``, from the first table that has it."""
    if len(path) > 1:
        return None
    keys = ((table, key) for table in known_keys(()) for key in known_keys((table,)))
    typed = _without_unit(str(path[0]).lower())
    return next((f"{table}.{key}" for table, key in keys if _without_unit(key) == typed), None)


def _without_unit(key: str) -> str:
    """``tilt_rad`` and ``tilt_deg`` are both ``tilt``."""
    for unit in sorted(filter(None, (*UNITS, *OTHER_UNITS)), key=len, reverse=True):
        if key.endswith(f"_{unit}"):
            return key.removesuffix(f"_{unit}")
    return key


def _unlike(path: KeyPath, value: Any, limits: Mapping[str, float] = MappingProxyType({})) -> str:
    """A value that a key does not accept, what it does, and the unit that a number may be in instead."""
    node = {**(node_at(path) or {}), **limits}
    ends = {
        key: end for branch in (*map(resolve, node.get("anyOf", ())), node) for key, end in branch.items()
    }
    low, high = (next((ends[name] for name in names if name in ends), None) for names in _ENDS)
    message = f"got {value!r}, expected {describe_value(node)}"
    if low is None or high is None or not _is_number(value) or low <= value <= high:
        return message
    key = next(part for part in reversed(path) if isinstance(part, str))
    suffix = max((unit for unit in UNITS if not unit or key.endswith(f"_{unit}")), key=len)
    meant = ((unit, (value - ZEROS.get(unit, 0.0)) / by) for unit, by in UNITS[suffix][1].items())
    fitting = [f"{number:.6g} if it is in {unit}" for unit, number in meant if low <= number <= high]
    return f"{message}; write {' or '.join(fitting)}" if fitting else message


def _is_number(value: Any) -> TypeGuard[float]:
    return type(value) in (int, float) and abs(value) < 1e18


# Checks between keys. They read the plain document and skip malformed values, which the models report, so
# that one mistake does not hide another.


def cross_check(document: Mapping[str, Any]) -> list[Mistake]:
    """Mistakes between keys: time zone, names, probes, reference, outlines, method, irradiance, pairs."""
    checks = (
        _timezone,
        _other_world,
        _device_names,
        _region_names,
        _shared_probes,
        _cameras_of_regions,
        _reference,
        _outside_the_frame,
        _crossed_outlines,
        _repeated_azimuths,
        _method,
        _irradiance,
        _incomplete_pairs,
        _simulated_field,
        _thresholds,
    )
    return [mistake for check in checks for mistake in check(document)]


def _thresholds(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Triggers without a threshold."""
    for name, table in table_in(document, "trigger").items():
        if isinstance(table, Mapping) and not {"above", "below"} & table.keys():
            yield Mistake(("trigger", name), "needs a threshold: above or below")


def unknown_drivers(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Drivers that are not installed here: allowed in a session from elsewhere, not in a campaign."""
    devices = table_in(document, "device")
    named = (((name,), table_in(document, name)) for name in INSTRUMENTS)
    others = ((("device", name), table_in(devices, name)) for name in devices)
    for path, table in (*named, *others):
        name = table.get("driver")
        if not isinstance(name, str) or name in registry.BUILT_IN or name in (installed := registry.names()):
            continue
        yield Mistake((*path, "driver"), f"unknown driver {name!r}; {did_you_mean(name, installed)}")


def _crossed_outlines(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Regions whose outline crosses itself."""
    for path, region in regions_in(document):
        corners = outline(region.get("points_px"))
        if corners and Region("", RegionKind.TARGET, tuple(corners)).crosses_itself:
            yield Mistake((*path, "points_px"), Words("issue.region.crosses"))


def _repeated_azimuths(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Horizons with two elevations of one azimuth."""
    for path, table in ((("site",), table_in(document, "site")), *regions_in(document)):
        pairs = table.get("horizon")
        horizon = pairs if isinstance(pairs, list) else ()
        azimuths = [pair[0] for pair in horizon if isinstance(pair, list) and pair]
        turns = [azimuth % 360.0 for azimuth in azimuths if _is_number(azimuth)]
        if len(set(turns)) < len(turns):
            yield Mistake((*path, "horizon"), "every azimuth may stand once (0 and 360 are the same)")


def outline(points: Any) -> list[tuple[float, float]] | None:
    """The corners of a region as pairs, or None if they are not at least three pairs of numbers."""
    if not isinstance(points, list) or len(points) < 3:
        return None
    pairs = [point for point in points if isinstance(point, list) and len(point) == 2]
    numbers = [(float(x), float(y)) for x, y in pairs if _is_number(x) and _is_number(y)]
    return numbers if len(numbers) == len(points) else None


def _timezone(document: Mapping[str, Any]) -> Iterator[Mistake]:
    name = table_in(document, "site").get("timezone")
    if not isinstance(name, str) or known_zone(name) is not None:
        return
    near = nearest(name, zoneinfo.available_timezones())
    message = f"unknown time zone {name!r}" + (f"; did you mean {near}?" if near else "")
    yield Mistake(("site", "timezone"), f"{message} (IANA names, such as Asia/Tokyo)")


def _other_world(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """A time zone, weather or a formula of daylight that only the Earth has."""
    site, simulation = table_in(document, "site"), table_in(document, "simulation")
    body = site.get("body", "earth")
    if body == "earth":
        yield from _beyond_the_earth(document)
    if body not in ("mars", "moon"):  # the schema refuses others
        return
    if site.get("timezone", "UTC") != "UTC":
        message = f"time zones belong to the Earth; omit it on {body}: local solar time is shown"
        yield Mistake(("site", "timezone"), message)
    if simulation.get("weather", "clear") != "clear":
        message = f"measured weather belongs to the Earth; set it to clear on {body}"
        yield Mistake(("simulation", "weather"), message)
    if table_in(document, "surface").get("kind", SAND) != SAND:
        message = f"kinds of surface are the Earth's; on {body} set [surface], [slab] and [prior]"
        yield Mistake(("surface", "kind"), message)
    for path, region in regions_in(document):
        if "surface_kind" in region:
            message = f"kinds of surface are the Earth's; omit it on {body}"
            yield Mistake((*path, "surface_kind"), message)
    if simulation.get("drawn"):
        yield Mistake(("simulation", "drawn"), f"drawn fields have the air of the Earth; omit it on {body}")
    irradiance = table_in(document, "irradiance")
    for key, instead in (("model", "efficacy, calibrated, pyrheliometer or file"), ("diffuse", "fraction")):
        if (stated_value := irradiance.get(key)) in OF_DAYLIGHT:
            message = f"{stated_value} is a formula of the Earth's daylight; on {body} use {instead}"
            yield Mistake(("irradiance", key), message)


EARTH: Mapping[KeyPath, tuple[float, float]] = {
    ("estimator", "longwave_down_w_m2"): LIMITS["longwave_down"].shown_limits,
    ("air", "density_kg_m3"): (0.3, 2.0),  # from above 10 km to -90 degC
}
"""Limits on the Earth, where other worlds have wider ones."""


def _beyond_the_earth(document: Mapping[str, Any]) -> Iterator[Mistake]:
    for path, (low, high) in EARTH.items():
        value = table_in(document, str(path[0])).get(str(path[1]))
        if _is_number(value) and not low <= value <= high:
            yield Mistake(path, _unlike(path, value, {"minimum": low, "maximum": high}))


def _device_names(document: Mapping[str, Any]) -> Iterator[Mistake]:
    for name in table_in(document, "device"):
        if name in INSTRUMENTS:
            yield Mistake(("device", name), f"this name is reserved for the table [{name}]; choose another")


def _region_names(document: Mapping[str, Any]) -> Iterator[Mistake]:
    seen: dict[str, str] = {}
    for path, region in regions_in(document):
        name = region.get("name")
        if not isinstance(name, str):
            continue
        if name.casefold() in seen:
            yield Mistake((*path, "name"), Words("error.duplicate", name=seen[name.casefold()]))
        seen.setdefault(name.casefold(), name)


def _shared_probes(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """A probe lies in one region only."""
    regions: dict[str, str] = {}
    for path, region in regions_in(document):
        probes = region.get("probes")
        for probe in probes if isinstance(probes, list) else ():
            if isinstance(probe, str) and probe in regions:
                yield Mistake((*path, "probes"), f"{probe} is in region {regions[probe]!r} already")
            elif isinstance(probe, str):
                regions[probe] = str(region.get("name"))


def _cameras_of_regions(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """A second camera is a device beside [camera], the first; the pose is that of the first."""
    for path, region in regions_in(document):
        camera = region.get("camera", "")
        if camera in ("", "camera") or not isinstance(camera, str):
            continue
        if camera not in table_in(document, "device") or "camera" not in document:
            yield Mistake((*path, "camera"), f"a second camera is [device.{camera}] beside [camera]")
        if region.get("points_m"):
            yield Mistake((*path, "points_m"), "camera.pose is that of [camera]; give points_px")


def _reference(document: Mapping[str, Any]) -> Iterator[Mistake]:
    regions = regions_in(document)
    is_needed = table_in(document, "estimator").get("reference") != "weather"
    if is_needed and regions and not any(region.get("kind") == "reference" for _, region in regions):
        yield Mistake(("region",), Words("error.no_reference"))
    for path, region in regions:
        if region.get("kind") == "reference" and "surface_kind" in region:
            yield Mistake((*path, "surface_kind"), Words("error.reference_surface"))
        if region.get("kind") == "blackbody" and not {"probes", "emissivity"} <= region.keys():
            yield Mistake((*path, "kind"), Words("error.blackbody"))


def _outside_the_frame(document: Mapping[str, Any]) -> Iterator[Mistake]:
    camera = table_in(document, "camera")
    width, height = camera.get("width_px"), camera.get("height_px")
    if not isinstance(width, int) or not isinstance(height, int):
        return
    for path, region in regions_in(document):
        for x, y in outline(region.get("points_px")) or () if not region.get("camera") else ():
            if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
                corner = {"x": f"{x:g}", "y": f"{y:g}", "cols": width, "rows": height}
                yield Mistake((*path, "points_px"), Words("error.corner_outside", **corner))
                break


def _method(document: Mapping[str, Any]) -> Iterator[Mistake]:
    table = table_in(document, "estimator")
    method, model = table.get("method", "unit-norm"), table.get("model", "learned")
    if method != "unit-norm" and model == "learned":
        message = f'method = "{method}" needs model = "paper" or "full"; the learned model has its own'
        yield Mistake(("estimator", "method"), message)


def _irradiance(document: Mapping[str, Any]) -> Iterator[Mistake]:
    table = table_in(document, "irradiance")
    if table.get("model") == "calibrated" and "factor" not in table:
        yield Mistake(("irradiance", "model"), 'model = "calibrated" needs irradiance.factor')
    mounting, plane = table.get("mounting", "horizontal"), ("plane_tilt_deg", "plane_azimuth_deg")
    if mounting == "in-plane" and not set(plane) <= table.keys():
        yield Mistake(("irradiance", "mounting"), f'mounting = "in-plane" needs {" and ".join(plane)}')
    if mounting == "horizontal" and "gti" in table_in(table, "measures").values():
        message = f'gti needs mounting = "in-plane" with {" and ".join(plane)}, or "sun-pointing"'
        yield Mistake(("irradiance", "measures"), message)


def _incomplete_pairs(document: Mapping[str, Any]) -> Iterator[Mistake]:
    camera = table_in(document, "camera")
    if ("width_px" in camera) != ("height_px" in camera):
        yield Mistake(("camera",), "width_px and height_px belong together")
    for path, region in regions_in(document):
        tilt, is_reference = region.get("tilt_deg"), region.get("kind") == "reference"
        if is_reference and isinstance(tilt, int | float) and tilt > 0 and "azimuth_deg" not in region:
            yield Mistake((*path, "tilt_deg"), Words("error.reference_azimuth"))


def _simulated_field(document: Mapping[str, Any]) -> Iterator[Mistake]:
    start = table_in(document, "simulation").get("start")
    if isinstance(start, datetime) and not 1970 < start.year <= YEARS[-1]:  # sessions count from 1970 on
        message = f"got {start.isoformat()}, the year must lie within 1971..{YEARS[-1]}"
        yield Mistake(("simulation", "start"), message)


_WORD = (
    r"[\w.-]*(?:password|passwd|passphrase|token|secret|api[_-]?key|access[_-]?key|credentials?|signature)"
)
_KEY = re.compile(rf"{_WORD}|pwd|auth", re.IGNORECASE)
_URL = re.compile(
    rf"://[^\s/?#]*:[^\s/?#]*@|https?://[^\s/?#]+@|://\S*[?&;#](?:{_WORD}|auth|key|pwd|pw|pass|sig)=[^\s&]",
    re.IGNORECASE,
)
"""A password or token in front of the host, or in the query."""
_SERVICE = re.compile(
    r"\b(?:tgram|signals?|matrixs?|msteams|workflows?|slack|discord|ntfys?|mailtos?|pover|gotifys?|jsons?)://"
    r"|\bntfy\.sh/\w|\btk_\w{20,}|api\.telegram\.org/bot|hooks\.slack\.com/|/api/webhooks/|webhook\.office",
    re.IGNORECASE,
)
"""Addresses of services that alarms are sent to, which hold tokens or are secret themselves."""
_STORED = "which every session would store"
_SERVICES = f"can hold a token, {_STORED}; write addresses into a private file, which services_file names"
_FILE = "holds the secret itself; write it into a file, and here that file's name"
_OTHER = f"looks like a password or token, {_STORED}; keep it in a file of its own"


def secrets_in(document: Mapping[str, Any]) -> Iterator[Mistake]:
    """Texts of a configuration that look like a secret: where, and what to do instead, without the secret."""
    for path, value in _values(document, ()):
        if value != "" and (message := _secret_message(path, value)):
            yield Mistake(path, message)


def _values(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, str | int]]:
    """Every text and whole number with its path, except the words of commands, which no session stores."""
    if path in (("alarms", "command"), ("fail_safe", "command")):
        return
    if isinstance(value, Mapping | list):
        parts = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, part in parts:
            yield from _values(part, (*path, key))
    elif isinstance(value, str | int) and not isinstance(value, bool):
        yield path, value


def _secret_message(path: KeyPath, value: str | int) -> str | None:
    text, key = str(value), str(path[-1])
    is_secret = _URL.search(text) or _SERVICE.search(text)
    if key.endswith("_file"):
        return _FILE if is_secret or "://" in text else None
    if path[0] == "alarms" and "://" in text:
        return _SERVICES
    return _OTHER if is_secret or _KEY.fullmatch(key) else None
