"""Formatting of numbers, times, states and events for the screen, the plain lines and the report.

Kelvin are shown as °C, and UTC as the site's local time with its zone. Unknown values are shown as a dash,
never as 0 or "nan".
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import UTC, datetime, tzinfo

from fieldkit.model.confidence import percent
from fieldkit.model.durations import rounded_duration
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.model.site import Region, RegionKind, Site, known_zone
from fieldkit.model.slope import (
    CERTAIN,
    SHORT_FIELDS,
    SLOPE_FIELDS,
    STEEP_SHARE,
    WITH_SLOPE,
    ReferenceCheck,
    SlopeEstimate,
    SlopeState,
    half_width_deg,
)
from fieldkit.model.units import CELSIUS_ZERO_K

UNKNOWN = "–"
PAPER_OMITS = (
    "the paper's model omits diffuse light, sky longwave and stored heat; outdoors, azimuth free, its "
    "likelihood regions miss the truth up to five times as often as stated"
)
"""Measured with simulated beds under measured weather (`benchmarks/estimation_window.py`)."""

MOST_LOPSIDED = 1.25
"""How far a region reaches from its tilt, in half-widths, where ± still describes it."""

_PREFIXES = {Severity.INFO: "", Severity.WARNING: "warning: ", Severity.ERROR: "ERROR: "}
_STATES = {
    SlopeState.OK: "ok",
    SlopeState.TOO_FEW: "too few minutes yet",
    SlopeState.WIDE: "wide",
    SlopeState.NOT_RESOLVED: "not resolved",
    SlopeState.NO_INTERSECTION: "no intersection",
    SlopeState.HELD_CLOUD: "held: cloud",
    SlopeState.LOW_SUN: "low sun",
    SlopeState.SHADED: "shaded",
    SlopeState.NO_DATA: "no data",
}


def number(value: float, digits: int = 0) -> str:
    """`value` with `digits` decimals and a space every three digits; a dash for NaN, no minus before 0."""
    return f"{value:z,.{digits}f}".replace(",", " ") if math.isfinite(value) else UNKNOWN


def celsius(temperature_k: float, digits: int = 2) -> str:
    """A temperature in °C, without the unit."""
    return number(temperature_k - CELSIUS_ZERO_K, digits)


def plus_minus(value: float, half: float, digits: int = 1) -> str:
    """A value with half the width of its region: ``15.1 ±0.9``."""
    if not math.isfinite(value):
        return UNKNOWN
    return number(value, digits) + (f" ±{half:.{digits}f}" if math.isfinite(half) else "")


def tilt(estimate: SlopeEstimate) -> str:
    """Tilt in degrees with its region: ``15.1 ±0.9``, or ``4.8 (4.0–12.2)`` where it is lopsided."""
    low_deg, value, half_deg = estimate.tilt_low_deg, estimate.tilt_deg, estimate.tilt_half_width_deg
    is_lopsided = max(estimate.tilt_high_deg - value, value - low_deg) > MOST_LOPSIDED * half_deg
    return f"{number(value, 1)} {_tilt_region(estimate)}" if is_lopsided else plus_minus(value, half_deg)


def tilt_degrees(estimate: SlopeEstimate) -> str:
    """The same with its unit."""
    words = tilt(estimate)
    return words if words == UNKNOWN else f"{words}°"


def region_words(sure: str) -> str:
    """Meaning of what stands behind a tilt, whose region has the confidence `sure`."""
    return f"±: half the width of the {sure} region, or (from–to) where it is lopsided"


def finding(estimate: SlopeEstimate) -> str:
    """A slope in one phrase: ``b25 22.6° (17.6–28.0), wide``; no word where it is certain."""
    words = f"{estimate.region} {number(estimate.tilt_deg, 1)}°"
    if math.isfinite(estimate.tilt_half_width_deg):
        words += f" {_tilt_region(estimate)}"
    return words if estimate.state in CERTAIN else f"{words}, {state(estimate)}"


def _tilt_region(estimate: SlopeEstimate) -> str:
    return f"({number(estimate.tilt_low_deg, 1)}–{number(estimate.tilt_high_deg, 1)})"


def findings(estimates: Iterable[SlopeEstimate], regions: Iterable[Region] = ()) -> str:
    """The slopes that were found, certain ones first, and the known beds; empty if there is none."""
    found = [estimate for estimate in estimates if estimate.state in WITH_SLOPE]
    certain = ", ".join(finding(estimate) for estimate in found if estimate.state in CERTAIN)
    others = [finding(estimate) for estimate in found if estimate.state not in CERTAIN]
    known = ", ".join(
        region.name for region in regions if region.kind is RegionKind.REFERENCE and region.tilt_deg
    )
    beds = [f"known: {known}"] if known and found else []
    return "; ".join(filter(None, (certain, *others, *beds)))


def slope_number(estimate: SlopeEstimate, key: str) -> str:
    """One of the `SLOPE_FIELDS`, with its decimals."""
    return number(getattr(estimate, key), SLOPE_FIELDS[key].digits)


def short_columns(estimate: SlopeEstimate) -> list[str]:
    """The `SHORT_FIELDS` of an estimate."""
    return [slope_number(estimate, field.key) for field in SHORT_FIELDS]


def noise(estimate: SlopeEstimate) -> str:
    """Uncertainty of the tilt by noise alone: ``±0.4°``, half the width of its likelihood region."""
    bounds = estimate.noise_tilt_low_deg, estimate.noise_tilt_high_deg
    half = float(half_width_deg(estimate.tilt_deg, *bounds))
    return f"±{half:.1f}°" if math.isfinite(half) else UNKNOWN


def azimuth(estimate: SlopeEstimate) -> str:
    """Azimuth in degrees with its likelihood region, a dash for a slope that may be flat (tilt from 0).

    Where its bounds meet the azimuth was given, not estimated.
    """
    value = estimate.azimuth_deg
    if estimate.tilt_low_deg == 0.0:
        return UNKNOWN
    if estimate.azimuth_low_deg == estimate.azimuth_high_deg:
        return f"{number(value)} given"
    return plus_minus(value, 0.5 * (estimate.azimuth_high_deg - estimate.azimuth_low_deg), digits=0)


def state(estimate: SlopeEstimate, *, second: bool = True) -> str:
    """The state of a slope: ``ok``, ``flat within 2.1°``, ``not resolved, or 43.3°/181°`` ...

    With `second` the other slope that fits is added.
    """
    if estimate.state is SlopeState.FLAT:
        return f"flat within {number(estimate.tilt_high_deg, 1)}°"
    words = _STATES.get(estimate.state) or estimate.state.name.lower()  # a state from a newer version
    if math.isfinite(estimate.along_sun_deg):
        return f"{number(estimate.along_sun_deg, 1)}° along the sun only"
    other = second_branch(estimate) if second else ""
    return f"{words}, or {other}" if other else words


def confidence(estimates: Iterable[SlopeEstimate]) -> str:
    """The confidence of some estimates: ``90 %``, or ``90 % or 95 %`` where it differs."""
    return " or ".join(
        percent(confidence) for confidence in sorted({estimate.confidence for estimate in estimates})
    )


def reference_check(check: ReferenceCheck) -> str:
    """A reference's slope by all others, such as 14.8° (13.9–15.7), and the stated one."""
    ends = f"{check.tilt_low_deg:.1f}–{check.tilt_high_deg:.1f}"
    words = f"reference {check.region}: {check.tilt_deg:.1f}° ({ends}) from the other regions"
    return f"{words}, stated {check.stated_tilt_deg:.1f}°{'' if check.holds else ': contradicted'}"


def wide_means(sure: str, target_deg: float) -> str:
    """Meaning of the state ``wide``, where regions have a `confidence` and `target_deg` is narrow enough."""
    return (
        f"± exceeds {target_deg:g}° and {STEEP_SHARE:.0%} of the tilt ({sure}), or there is a reason not to "
        "rely on it"
    )


def second_branch(estimate: SlopeEstimate) -> str:
    """The other slope that fits the same data, tilt/azimuth, or nothing."""
    if not math.isfinite(estimate.second_tilt_deg):
        return ""
    return f"{estimate.second_tilt_deg:.1f}°/{number(estimate.second_azimuth_deg)}°"


def event_line(event: Event) -> str:
    """An event's text with its severity as a prefix, for output without colour; marks are labelled."""
    mark = "mark " if event.kind is EventKind.MARK else ""
    return _PREFIXES.get(event.severity, "warning: ") + mark + event_text(event)


def event_text(event: Event) -> str:
    """An event's text; for a mark with its kind and duration: ``cloud, 3 min: over the ridge``."""
    label, end_ns = str(event.data.get("label", "")), int(event.data.get("end_ns", 0))
    lasted = rounded_duration((end_ns - event.time_ns) / 1e9) if end_ns else ""
    about = ", ".join(word for word in (label, lasted) if word)
    return f"{about}: {event.text}" if about else event.text


def by_time(events: Iterable[Event]) -> list[Event]:
    """Events in order of time: a mark may refer to a time long before it was recorded."""
    return sorted(events, key=lambda event: event.time_ns)


def given_slope(region: Region) -> str:
    """The measured tilt and azimuth of a region: ``15°/180°``, or a dash."""
    if not math.isfinite(region.tilt_deg):
        return UNKNOWN
    if region.tilt_deg == 0 or not math.isfinite(region.azimuth_deg):
        return f"{region.tilt_deg:g}°"
    return f"{region.tilt_deg:g}°/{region.azimuth_deg:g}°"


def kind(region: Region) -> str:
    """``reference``, ``target``, ``blackbody`` or ``foil``."""
    return region.kind.name.lower()


def zone(site: Site) -> tzinfo:
    """The site's time zone; UTC if its name is unknown on this computer."""
    return known_zone(site.timezone) or UTC


def local_time(time_ns: int, site: Site) -> datetime:
    """`time_ns` as an aware datetime in the site's zone, to the microsecond."""
    return datetime.fromtimestamp(time_ns / 1e9, zone(site))


def of_day_ns(time_ns: int, site: Site) -> int:
    """Nanoseconds on the site's clocks since their last midnight."""
    local = local_time(time_ns, site)
    return ((local.hour * 60 + local.minute) * 60 + local.second) * 10**9 + time_ns % 10**9


def clock_time(time_ns: int, site: Site, *, seconds: bool = False, since_ns: int | None = None) -> str:
    """``12:04`` or ``12:04:31`` at the site; name the zone beside it with `zone_name`.

    With its date where that is another than the one of `since_ns`, if given.
    """
    local = local_time(time_ns, site)
    is_dated = since_ns is not None and local.date() != local_time(since_ns, site).date()
    return local.strftime(("%Y-%m-%d " if is_dated else "") + ("%H:%M:%S" if seconds else "%H:%M"))


def zone_name(time_ns: int, site: Site, until_ns: int | None = None) -> str:
    """The time zone at `time_ns` with its offset: ``JST, UTC+09:00``; two where it is another `until_ns`."""
    if until_ns is not None:
        return ", then ".join(dict.fromkeys((zone_name(time_ns, site), zone_name(until_ns, site))))
    local = local_time(time_ns, site)
    offset = local.strftime("%z")
    name = local.tzname() or site.timezone
    words = f"UTC{offset[:3]}:{offset[3:5]}"
    return "UTC" if name == "UTC" else words if name[0] in "+-" else f"{name}, {words}"


def place(site: Site) -> str:
    """``37.7000 N 105.9230 W, 2317 m``."""
    north = "N" if site.latitude_deg >= 0 else "S"
    east = "E" if site.longitude_deg >= 0 else "W"
    return (
        f"{abs(site.latitude_deg):.4f} {north} {abs(site.longitude_deg):.4f} {east}, {site.elevation_m:.0f} m"
    )


def rate(rate_hz: float) -> str:
    """``9.0/s``, or ``3/min`` for what comes less than every other second."""
    return f"{number(rate_hz * 60)}/min" if rate_hz < 0.5 else f"{number(rate_hz, 1)}/s"


def size(n_bytes: float) -> str:
    """``640 kB``, ``28 MB`` or ``11.2 GB``."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if n_bytes >= factor:
            return f"{n_bytes / factor:.{1 if n_bytes < 99 * factor else 0}f} {unit}"
    return f"{n_bytes:.0f} B"
