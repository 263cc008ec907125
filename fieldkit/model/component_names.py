"""Component of radiation by the label of a column or channel, in the words of the archives of radiation.

Words are those in the lists of variables of BSRN, SURFRAD, SolRad, MIDC, NSRDB, PVGIS, CAMS, Open-Meteo, NASA
POWER, FLUXNET, ARM and pvlib. ``direct_radiation`` is horizontal for Open-Meteo, and not known elsewhere;
sunlight that the ground reflects, of a clear sky or above the air is no component of what falls on the field.
"""

from __future__ import annotations

import re
from functools import lru_cache
from unicodedata import normalize

_LONGWAVE = (
    r"lw|lw[diu]\w*|lwout\w*|long ?wave\w*|long hemisp\w*|ir|infra ?red|pir|pyrgeometer\w*|r?ldown|r?lup"
    r"|rlds|rlus|strd|terrestrial|thermal|gegenstrahlung"
)
_UP = r"u|uw|up\w*|out|outgoing|emitted|refl\w*|lwu\w*|lwout\w*|lup|rlus|swu\w*|swout\w*|rsus"
_DOWN = r"dn|dwn?|down\w*|in|incoming|incident"
_SKY = r"d|h|horizontal|sky|atmos\w*|lwd\w*|lwin\w*|r?ldown|rlds|strd|gegen\w*"
_TILTED = r"gti|poai?|plane of array|tilt\w*|in ?plane|inclin\w*|g i"
_DIFFUSE = r"dhi|diffus\w*|diff?|gd h|swdif|散乱\w*"
_DIRECT = r"direct|beam|dir"
_NORMAL = rf"dni|bni|ebn|gb n|nip|chp ?1|pyrheliometer\w*|直達\w*|(?:{_DIRECT})\b.*\b(?:normal|norm|n)"
_GLOBAL = rf"ghi|global\w*|glo|g h|short ?wave\w*|ssrd|rsds|swd(?:n|own)?|swin\w*|sw (?:d|{_DOWN})|全天\w*"
_NONE = (
    r"cl(?:ea)?r ?(?:sky)?|mcclear|cs|extra\w*|etrn?|toa|net\w*|albedo|uv\w*|par|ppfd|[ro]g ?\d+|bhi|ebh"
    r"|g[bdr] i|\d+ ?(?:north|south|east|west|axis)|no corr|ground|(?<!\d )min|max\w*|high|low|std|stdev|sd"
    r"|unc\w*|error|flag|qc"
)
_ROWS = (
    ("", (_NONE,)),
    ("longwave_up", (_LONGWAVE, _UP)),
    ("longwave_down", (_LONGWAVE, rf"{_DOWN}|{_SKY}")),
    ("", (_LONGWAVE,)),
    ("", (_UP,)),
    ("", (_DIFFUSE, _TILTED)),
    ("dhi", (_DIFFUSE,)),
    ("dni", (_NORMAL,)),
    ("", (_DIRECT, rf"h|horiz\w*|rad\w*|irr\w*|{_TILTED}")),
    ("dni", (_DIRECT,)),
    ("gti", (_TILTED,)),
    ("", (r"normal|track\w*",)),
    ("ghi", (_GLOBAL,)),
    ("ghi", (r"solar|psp|pyranometer\w*|short", _DOWN)),
)
"""A label is what the first row says all of whose patterns it has."""


@lru_cache(1024)
def component_named(label: str) -> str:
    """The component of radiation that a label names, such as ``Gb(n)`` or ``SWDown_Avg``; "" for others."""
    return next((component for component, patterns in _ROWS if _has(label, *patterns)), "")


def may_measure(label: str, component: str) -> bool:
    """False where a label names the other side of the spectrum: a pyrgeometer measures no sunlight."""
    is_longwave = component.startswith("longwave")
    return _has(label, _LONGWAVE) == is_longwave or not _has(label, rf"{_LONGWAVE}|{_GLOBAL}|solar|pyr\w*")


def _has(label: str, *patterns: str) -> bool:
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", normalize("NFKC", label))
    words = re.sub(r"[\W_]+", " ", words).lower()
    return all(re.search(rf"\b(?:{pattern})\b", words) for pattern in patterns)
