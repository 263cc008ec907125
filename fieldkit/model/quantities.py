"""The one table of quantities: unit, spellings, limits, words. A new quantity is one more row of it.

Drivers, imports, stations, the table ``[limits]``, exports and views read it. Sources of limits: BSRN is
C. N. Long and E. G. Dutton, "BSRN Global Network recommended QC tests, V2.0", 2002, physically possible and
extremely rare limits; WMO the World Weather and Climate Extremes Archive. Factors of units: NIST Special
Publication 811, appendix B.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args
from unicodedata import normalize

from fieldkit.model.component_names import component_named
from fieldkit.model.units import CELSIUS_ZERO_K

if TYPE_CHECKING:
    from fieldkit.model.arrays import FloatArray

Range = tuple[float, float]
Component = Literal["dni", "ghi", "gti", "dhi", "longwave_down", "longwave_up"]
"""Direct normal, global horizontal, global tilted and diffuse horizontal irradiance; longwave both ways.

All are in W/m2, but none can replace another: 400 W/m2 of global irradiance at 22 degrees of solar elevation
belong to a beam of 900.
"""
COMPONENTS: tuple[str, ...] = get_args(Component)
UNKNOWN = "unknown"
"""Quantity of a stream that is stored as it came, in a unit that no row has; no estimate uses it."""

SUN_W_M2 = 1361.0 / 0.9833**2
"""Above the atmosphere at perihelion: total solar irradiance of Kopp and Lean, 2011, at 0.9833 au."""
ZERO_OFFSET_W_M2 = -41.0
"""Total zero offset of the worst class of pyranometers, ISO 9060:2018, class C: below it nothing is light."""
EFFICACY_LM_W = 120.0
"""No global daylight has more lumens per watt; P. J. Littlefair, Lighting Res. Technol. 17, 1985."""
HOTTEST_K = 440.0
"""A black surface that only radiates, under all that sun and sky give: (1408 + 700) W/m2 / sigma, 439 K."""
FAHRENHEIT_TO_K = (459.67, 1.8)
"""Kelvin of a temperature in °F: add the first, divide the sum by the second."""
FOOT2_M2 = 0.09290304
"""One square foot, for foot-candles; a foot is 0.3048 m exactly."""


class Unit(NamedTuple):
    """A unit as it is written: a number in it becomes ``(number + add) / by`` in the stream's unit.

    `spellings` are others than `shown`, as `_plain` leaves them; `suffix` ends keys (``_w_m2``), `short_cut`
    the names of Campbell Scientific's Short Cut, as ``T109_C``.
    """

    shown: str
    spellings: str = ""
    add: float = 0.0
    by: float = 1.0
    suffix: str = ""
    short_cut: tuple[str, ...] = ()

    def shown_value(self, value: float) -> float:
        """A value of a stream in this unit."""
        return value * self.by - self.add


class Units(NamedTuple):
    """The unit of a stream, Home Assistant's device class, its units as written, the shown one first."""

    stored: str
    device_class: str
    written: tuple[Unit, ...]


def _units(stored: str, device_class: str, *written: Unit) -> Units:
    return Units(stored, device_class, written)


TEMPERATURE = _units(
    "K",
    "temperature",
    Unit("°C", "centigrade celsius", CELSIUS_ZERO_K, suffix="c", short_cut=("AirTC", "_C")),
    Unit("K", "kelvin", suffix="k"),
    Unit("°F", "fahrenheit", *FAHRENHEIT_TO_K, "f", ("AirTF", "_F")),
)
LIGHT = _units(
    "lx",
    "illuminance",
    Unit("lx", "lux lm/m2 lumen/m2 lumens/m2", suffix="lx"),
    Unit("klx", "klux kilolux", by=1e-3),
    Unit("fc", "ftc ftcd ft-cd foot-candle foot-candles footcandle footcandles lm/ft2", by=FOOT2_M2),
)
POWER = _units(
    "W m-2",
    "irradiance",
    Unit("W/m²", suffix="w_m2", short_cut=("SlrW",)),
    Unit("kW/m²", by=1e-3, short_cut=("SlrkW",)),
    Unit("mW/cm²", by=0.1),
    Unit("µW/cm²", by=100.0),
)
SPEED = _units(
    "m s-1",
    "wind_speed",
    Unit("m/s", "ms-1 m/sec meters/second", suffix="m_s", short_cut=("_ms",)),
    Unit("km/h", "kmh-1 kmh kph km/hr", by=3.6),
    Unit("mph", "mi/h miles/hour", by=1.0 / 0.44704),
    Unit("kn", "kt kts knot knots", by=3600.0 / 1852.0),
)
ANGLE = _units("degree", "wind_direction", Unit("°", "deg degree degrees"))
PRESSURE = _units(
    "Pa",
    "atmospheric_pressure",
    Unit("hPa", "mbar mb", by=0.01),
    Unit("Pa"),
    Unit("kPa", by=1e-3),
    Unit("inHg", by=1.0 / 3386.389),
    Unit("mmHg", by=1.0 / 133.3224),
)
WATER = _units("m3 m-3", "", Unit("m³/m³", "m3m-3", suffix="m3_m3"), Unit("%", "%vol vol%", by=100.0))
_OTHERS = """% %rh rh% pct percent bar v mv a ma w mw kw ppm ppb db dbm hz khz rpm ohm kohm mm mm/h mm/hr
ug/m3 us/cm j/m2 kj/m2 mj/m2 j/cm2 wh/m2 kwh/m2 umol/m2/s umolm-2s-1"""
OTHER_UNITS = frozenset(_OTHERS.split())
"""Units that no row has, as `_plain` leaves them: a column that states one is of another quantity."""


class Limit(NamedTuple):
    """Least and greatest value of a quantity in the unit of its streams.

    Sunlight also depends on the sun: at a sine `s` of its elevation no more than
    ``by_sun[0] * max(s, 0)**1.2 + by_sun[1]``.
    """

    low: float = -math.inf
    high: float = math.inf
    by_sun: Range | None = None


ANYTHING = Limit()


class Rare(NamedTuple):
    """Least and greatest value that is not extremely rare, W/m2.

    The greatest is ``share * top * max(s, 0)**power + high`` for light of `top` above the atmosphere and a
    sine `s` of the sun's elevation.
    """

    low: float
    high: float
    share: float = 0.0
    power: float = 1.0


def _sunlight(share: float, offset_w_m2: float) -> Limit:
    """Limits of BSRN: a share of the sun's light, by the power 1.2 of its sine; `high` is for the zenith."""
    rise = share * SUN_W_M2
    return Limit(ZERO_OFFSET_W_M2, rise + offset_w_m2, (rise, offset_w_m2))


_SURFACE, _COLD = Limit(175.0, HOTTEST_K), (20.0, HOTTEST_K)
"""-98 degC, Scambos et al., Geophys. Res. Lett. 45, 2018; 25 K in shadows at the Moon's poles: Paige et al.,
Science 330, 2010."""
_GLOBAL = _sunlight(1.5, 100.0)  # with light from the edges of clouds; BSRN
_RISE = SUN_W_M2 / math.sin(math.radians(0.5)) ** 1.2
_BEAM = Limit(ZERO_OFFSET_W_M2, SUN_W_M2, (_RISE, 100.0))
"""All of the sun's light from half a degree on; a summit sees it, weak, two degrees below the horizontal."""
_ILLUMINANCE = Limit(0.0, EFFICACY_LM_W * _GLOBAL.high, (EFFICACY_LM_W * _RISE, EFFICACY_LM_W * 100.0))
"""The same for a meter, which may face the sun."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One quantity: the row of all that must be known of it.

    Attributes
    ----------
    name : str
        Quantity of a stream, or a component of radiation.
    units : Units
        Its stream's unit, and the units it is written in.
    words : str
        Name for people.
    limit, elsewhere : Limit, Range
        Values that can be, on the Earth and on other worlds.
    rare : Rare
        Values that are not extremely rare.
    key : str
        Name in ``[limits]``, where it is another.
    stream : str
        Quantity of its streams, where it is another: a component is an irradiance.
    names : str
        Labels of columns and channels that mean it; without any, its unit alone does.
    of_station : str
        Name of its stream of an imported weather station.
    of_jma : str
        Its item in downloads of the Japan Meteorological Agency.
    is_angle : bool
        True for degrees around a circle, whose mean is that of the directions.
    """

    name: str
    units: Units
    words: str = ""
    limit: Limit = ANYTHING
    elsewhere: Range | None = None
    rare: Rare | None = None
    key: str = ""
    stream: str = ""
    names: str = ""
    of_station: str = ""
    of_jma: str = ""
    is_angle: bool = False

    def is_named(self, label: str) -> bool:
        """True if a label, with or without its unit, means it."""
        return bool(self.names) and _plain_label(label) in (self.name, *self.names.split())

    @property
    def limits_key(self) -> str:
        """Its key in ``[limits]``, such as ``air_temperature_c``."""
        return f"{self.key or self.name}_{self.shown.suffix}"

    @property
    def shown(self) -> Unit:
        """The unit for people."""
        return self.units.written[0]

    @property
    def shown_limits(self) -> Range:
        """Least and greatest value in the unit for people."""
        return self.shown.shown_value(self.limit.low), self.shown.shown_value(self.limit.high)

    @property
    def possible_limits(self) -> Range:
        """Least and greatest end that limits may have: ten times as much, and only radiation below zero."""
        least = -self.limit.high if self.units is POWER else 0.0
        return self.shown.shown_value(least), self.shown.shown_value(10.0 * self.limit.high)


def _component(
    name: str, words: str, limit: Limit, rare: Rare | None = None, station: str = "", jma: str = ""
) -> Quantity:
    kind = "longwave_irradiance" if name.startswith("longwave") else "irradiance"
    elsewhere = (-5.0, limit.high) if kind == "longwave_irradiance" else None  # a pyrgeometer's own noise
    return Quantity(name, POWER, words, limit, elsewhere, rare, "", kind, name, station, jma)


_ROWS = (
    Quantity("temperature", TEMPERATURE, "contact thermometers", _SURFACE, _COLD, key="probe_temperature"),
    Quantity(
        "brightness_temperature", TEMPERATURE, "pixels of regions", _SURFACE, _COLD, key="surface_temperature"
    ),
    Quantity(  # -89.2 degC, Vostok 1983, WMO; 350 K, BSRN: housings in the sun
        "air_temperature", TEMPERATURE, "air", Limit(183.9, 350.0), _COLD,
        names="air t_air tair air_t air_temp temp_air airtc temperature_2m t2m", of_station="air",
        of_jma="気温",
    ),
    Quantity("illuminance", LIGHT, "illuminance, less at night", _ILLUMINANCE),
    # also net radiation
    Quantity("irradiance", POWER, "irradiance of unknown component", Limit(-400.0, _GLOBAL.high)),
    # BSRN; no beam from a sun that is down; the plane of gti may face one that is low
    _component("dni", "direct normal, none at night", _BEAM, Rare(-2.0, 10.0, 0.95, 0.2), "direct"),
    _component(
        "ghi", "global horizontal, less by the sun's height", _GLOBAL, Rare(-2.0, 50.0, 1.2, 1.2),
        "global", "日射量",
    ),
    _component("gti", "global tilted irradiance", _GLOBAL._replace(by_sun=None)),
    _component(
        "dhi", "diffuse horizontal, less by the sun's height", _sunlight(0.95, 50.0),
        Rare(-2.0, 30.0, 0.75, 1.2), "diffuse",
    ),
    _component("longwave_down", "downward longwave", Limit(40.0, 700.0), Rare(60.0, 500.0), "longwave-down"),
    _component("longwave_up", "upward longwave", Limit(40.0, 900.0), None, "longwave-up"),
    Quantity("speed", SPEED, key="wind_speed"),
    Quantity(  # gust of 113.2 m/s, Barrow Island 1996, WMO
        "wind_speed", SPEED, "wind speed", Limit(0.0, 113.3), names="wind windspeed ws wind_speed_10m ws10m",
        of_station="wind", of_jma="風速",
    ),
    Quantity("wind_direction", ANGLE, names="winddir wind_dir wd wdir", is_angle=True),
    Quantity(  # reduced to the sea: the pressure at the station is what weighs on the field
        "air_pressure_at_mean_sea_level", PRESSURE, names="sea_level_pressure",
        of_station="sea-level-pressure", of_jma="海面気圧",
    ),
    Quantity("air_pressure", PRESSURE, names="pressure baro bp", of_station="pressure", of_jma="気圧"),
    Quantity("soil_moisture", WATER, "soil moisture by volume", Limit(0.0, 1.0), names="vwc water_content"),
)  # fmt: skip
QUANTITIES: Mapping[str, Quantity] = {row.name: row for row in _ROWS}
LIMITS: Mapping[str, Quantity] = {row.key or row.name: row for row in _ROWS if row.words}
"""The rows by their names in ``[limits]``."""
BY_UNIT: Mapping[str, Quantity] = {row.units.stored: row for row in reversed(_ROWS) if not row.names}
"""Quantity of a stream of which the unit alone is known."""


_SIGNS = str.maketrans(
    {"º": "°", "˚": "°", "\ufffd": "°", "Â": "", "\u0421": "C", "$": "", "−": "-", "μ": "u"}
)
_DEGREES = re.compile(
    r"^(?:degrees?|degs?|grad|[°'o?]|&deg;)_?(?=(?:[cfk]|celsius|centigrade|fahrenheit|kelvin)$)"
)
_PER_AREA = re.compile(r"^([kmu]?w|lm|[mk]?j|k?wh)[/_]?(c?m)(?:2|-2|qm)$")


def _plain(written: str) -> str:
    """A unit as it is compared: ``W·m⁻²`` is ``w/m2``, ``° C``, ``(*C)``, ``deg. C`` and ``oC`` are ``c``."""
    text = normalize("NFKC", written.translate(_SIGNS)).translate(_SIGNS).lower().replace("micro", "u")
    text = re.sub(r"[\s^*.·•⋅∙(){}\[\]]", "", text).strip("_")
    text = re.sub(r"square-?met(?:er|re)s?|sq-?met(?:er|re)s?|sqm|(?<=/)qm", "m2", text)
    text = re.sub(r"watts?(?=/|per|m)", "w", text).replace("perm2", "/m2").replace("percm2", "/cm2")
    return _PER_AREA.sub(r"\1/\g<2>2", _DEGREES.sub("", re.sub(r"^([cf])°$", r"\1", text)))


_SPELLINGS: dict[str, list[tuple[Quantity, Unit]]] = {}
for _row in _ROWS:
    for _unit in _row.units.written:
        for _spelling in {_unit.shown, _unit.suffix or _unit.shown, *_unit.spellings.split()}:
            _SPELLINGS.setdefault(_plain(_spelling), []).append((_row, _unit))


class Meaning(NamedTuple):
    """Meaning of a column's numbers: their quantity, and the unit they are written in."""

    quantity: Quantity
    unit: Unit

    def in_stream_unit(self, number: float) -> float:
        """A written number in the unit of the stream."""
        return (number + self.unit.add) / self.unit.by


def row_of(quantity: str, stored: str) -> Quantity:
    """The row of a stream, by its quantity or else its unit; an unknown one where neither is in the table."""
    row = QUANTITIES.get(quantity)
    if row is not None and row.units.stored == stored:
        return row
    usual = BY_UNIT.get(stored) if quantity != UNKNOWN else None
    return usual or unknown_meaning(stored).quantity


KNOWN_UNITS = ", ".join(unit.shown for row in _ROWS if row in BY_UNIT.values() for unit in row.units.written)
"""Units that need no label."""


def unit_of(written: str) -> Unit | None:
    """The unit that is written so; None if no row has it."""
    return next((unit for _, unit in _SPELLINGS.get(_plain(written), ())), None)


@lru_cache(1024)
def meaning_of(written: str, label: str = "") -> Meaning | None:
    """Meaning of numbers in a written unit, below a label where the unit is of several quantities, as ``%``.

    None if it is not known.
    """
    word = _plain_label(label)
    rows = _SPELLINGS.get(_plain(written), ())
    return next((Meaning(row, unit) for row, unit in rows if not row.names or row.is_named(word)), None)


def unknown_meaning(written: str) -> Meaning:
    """Meaning of numbers that are stored as they came, in the unit that is written."""
    unit = Unit(written)
    return Meaning(Quantity(UNKNOWN, _units(written, "", unit)), unit)


def quantity_named(label: str, stored: str) -> str:
    """The quantity that a label names (``GHI``, ``DNI_Avg``, ``T_air``, ``AirTC``) in a stream's unit, or "".

    Other labels are ambiguous: ``sun`` or ``pyranometer 2`` may be of any plane, a thermometer anywhere.
    """
    if stored == POWER.stored:
        return component_named(label)
    return next((row.name for row in _ROWS if row.units.stored == stored and row.is_named(label)), "")


# --- labels of columns and channels

_BEFORE_UNIT = re.compile(
    r"\s*[-–—,;]\s+|\s*[/|:.]\s*|\s+in\s+|[\s_-]+|(?<=[a-z0-9)])(?=[A-Z%µ])|(?=[°º˚℃℉])"
)
# also speed and direction of Campbell's WindVector
_STATISTIC = re.compile(
    r"(?<=.)[ _](?:avg|average|mean|min|max|std|smp|(?:s|d1)_wvt|wvc\([12]\))$", re.IGNORECASE
)
_BRACKETS = re.compile(r"\s*[,:/-]?\s*(?:\[([^\[\]]+)\]|\(([^()]+)\)|\{([^{}]+)\})")
_OF_TEMPERATURE = re.compile(r"temp|tmp|dew|bulb|^t[^c\W]?\d*$", re.IGNORECASE)


def split_label(label: str) -> tuple[str, str]:
    """Name and unit of a label: ``T1 [C]``, ``light (lx)``, ``Temp - °C``, ``temp_c``, ``tempC``; else "".

    A letter alone is a unit where it cannot be the letter of a sensor: ``Temp C``, and not ``Sensor C``.
    """
    for bracket in _BRACKETS.finditer(label):
        unit = next(filter(None, bracket.groups())).strip()
        name = (label[: bracket.start()] + label[bracket.end() :]).strip()
        if is_unit(unit) and name:
            return name, unit
    if is_unit(label) and len(label) > 1:
        return label, label
    name = _STATISTIC.sub("", label)
    for mark in _BEFORE_UNIT.finditer(name):
        before, unit = name[: mark.start()], name[mark.end() :]
        is_letter = unit.isalpha() and len(unit) == 1 and mark[0] in ("", " ", "_", "-")
        of_degrees = (mark[0] == "_" and unit in "CFcf") or _OF_TEMPERATURE.search(before)
        if before and is_unit(unit) and (of_degrees or not is_letter):
            return before, unit
    return label, ""


def is_unit(written: str) -> bool:
    """True for a unit that is known, though a quantity may have no row."""
    plain = _plain(written)
    return plain in _SPELLINGS or (plain in OTHER_UNITS and (plain == "%" or len(plain) > 1))


def _plain_label(label: str) -> str:
    words = re.sub("[ -]", "_", _STATISTIC.sub("", split_label(label.strip())[0]).lower())
    return words.removesuffix("_ms")


def short_cut_unit(name: str) -> str:
    """The unit in a name of Campbell Scientific's Short Cut, such as ``T109_C`` or ``SlrW``."""
    units = (unit for row in _ROWS for unit in row.units.written)
    return next((unit.shown for unit in units if unit.short_cut and name.endswith(unit.short_cut)), "")


def kelvin_if_fahrenheit(kelvin: FloatArray) -> FloatArray:
    """Kelvin of a reading that was converted as °C although the instrument showed °F."""
    return (kelvin - CELSIUS_ZERO_K - 32.0) / 1.8 + CELSIUS_ZERO_K
