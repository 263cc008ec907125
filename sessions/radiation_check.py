"""Tests of measured radiation as BSRN makes them: rare values, components together, longwave and air.

C. N. Long and Y. Shi, "An automated quality assessment and control algorithm for surface radiation
measurements", Open Atmos. Sci. J. 2, 23-37, 2008; the numbers are those of the "BSRN recommended QC tests,
V2.0". What is physically impossible is flagged elsewhere (`fieldkit.model.limits`) and takes no part. All of
it is about minute means.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime

import numpy as np

from fieldkit.model.arrays import BoolArray, FloatArray, IntArray
from fieldkit.model.channels import AIR_TEMPERATURE, air_quantities, radiation_components
from fieldkit.model.finding import Finding
from fieldkit.model.limits import RARE, is_rare
from fieldkit.model.site import Site, known_zone
from fieldkit.model.units import MINUTE_NS
from fieldkit.phrases import Words
from fieldkit.physics.bodies import EARTH, body_of
from fieldkit.physics.constants import STEFAN_BOLTZMANN
from fieldkit.physics.daylight import extraterrestrial
from fieldkit.physics.sun import sun_vectors
from fieldkit.sessions.analysis import minute_means
from fieldkit.sessions.reader import SessionReader

HIGH_SUN, LOWEST_SUN = np.cos(np.radians([75.0, 93.0]))
LEAST_W_M2 = 50.0
"""Of the light that components are compared at."""
CLOSURE = 0.08, 0.15
"""Global irradiance over the sum of its components less 1 at most: sun above 15 degrees, and a low one."""
DIFFUSE = 1.05, 1.10
"""Diffuse over global irradiance at most, likewise."""
OF_AIR = 0.4, 25.0
"""Longwave over that of a black body as warm as the air: at least this share, at most this much more."""


def radiation_findings(session: SessionReader) -> Iterator[Finding]:
    """A warning for each test that minutes fail, else that they pass; nothing without radiation."""
    if body_of(session.site) is not EARTH:
        return
    minute, means = _means(session)
    if not (names := [name for name in means if name != AIR_TEMPERATURE]):
        return
    time_ns = minute * MINUTE_NS + MINUTE_NS // 2
    failed = False
    for test, component, flags in _tests(means, time_ns, session.site):
        if flags.any():
            failed = True
            yield _failure(test, component, flags, time_ns, session.site)
    if not failed:
        yield Finding("ok", "radiation", f"{', '.join(names)}: all minutes pass the tests of BSRN")


def _failure(test: str, component: str, flags: BoolArray, time_ns: IntArray, site: Site) -> Finding:
    first = datetime.fromtimestamp(time_ns[flags][0] / 1e9, known_zone(site.timezone) or UTC)
    time = f"{first:%Y-%m-%d %H:%M %Z}"
    text = Words(f"issue.radiation.{test}", component=component, count=int(flags.sum()), time=time)
    return Finding("warn", "radiation", text, "level, clean and unshade the instruments; check their units")


def _tests(
    means: Mapping[str, FloatArray], time_ns: IntArray, site: Site
) -> Iterator[tuple[str, str, BoolArray]]:
    """Each test that the components allow, its component, and the minutes (n,) that fail it."""
    sine, top = sun_vectors(time_ns, site)[:, 2], extraterrestrial(time_ns)
    for name in (name for name in RARE if name in means):
        yield "rare", name, is_rare(name, means[name], sine, top)
    ghi, dhi, dni = (means.get(name) for name in ("ghi", "dhi", "dni"))
    is_high, is_up = sine > HIGH_SUN, sine > LOWEST_SUN
    if ghi is not None and dhi is not None:
        lit, most = is_up & (ghi > LEAST_W_M2), np.where(is_high, *DIFFUSE)
        yield "diffuse", "dhi", lit & (dhi > most * ghi)
        if dni is not None:
            both = dhi + dni * sine
            lit, off = is_up & (both > LEAST_W_M2), np.where(is_high, *CLOSURE)
            yield "closure", "ghi", lit & (np.abs(ghi / np.where(lit, both, 1.0) - 1.0) > off)
    longwave, air_k = means.get("longwave_down"), means.get(AIR_TEMPERATURE)
    if longwave is not None and air_k is not None:
        black = STEFAN_BOLTZMANN * air_k**4
        least, more = OF_AIR
        yield "longwave", "longwave_down", (longwave < least * black) | (longwave > black + more)


def _means(session: SessionReader) -> tuple[IntArray, dict[str, FloatArray]]:
    """Minutes (n,) of the session, and the mean of each component in them, NaN where there is none."""
    first, last = session.start_ns // MINUTE_NS, session.end_ns // MINUTE_NS
    minute = np.arange(first, last + 1)
    means: dict[str, FloatArray] = {}
    for info in session.streams.values():
        for channel, name in enumerate(radiation_components(info, {}) or air_quantities(info)):
            if name in (*RARE, AIR_TEMPERATURE) and name not in means and session.count(info.name):
                middle_ns, mean = minute_means(session, info.name, channel)
                means[name] = np.full(minute.size, np.nan)
                means[name][np.clip(middle_ns // MINUTE_NS - first, 0, minute.size - 1)] = mean
    return minute, means
