"""The plan of a measuring day in words, as rows, and as a page to print.

The day comes from a `DayPlan`, what a session will determine from its prediction (`Session`); times are
shown in the site's zone. The page is one self-contained HTML file; its charts need matplotlib, without it the
tables stand alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldkit.estimation.day_plan import FLAT_DEG, WEAK_K_PER_DEG, WINDOW_MIN, DayPlan, label
from fieldkit.model.arrays import FloatArray, IntArray
from fieldkit.model.site import Site
from fieldkit.physics.facet import angle_between_deg, normal
from fieldkit.views import formatting, plotting
from fieldkit.views.html import Figure, Table, render

COLUMNS = ("at", "sun", "azimuth", "W/m² per °", "K per °", "hour")
ASIDE_DEG = 10.0
"""Turn of a twin against its slope from which the azimuth tells them apart."""


@dataclass(frozen=True, slots=True)
class Session:
    """A predicted session: its end in words, its table, and its course.

    `course` are times (m,) and half of the likelihood region of each tilt then (m, f). [UTC ns], [degrees]
    """

    summary: Sequence[str]
    table: Table
    course: tuple[IntArray, FloatArray]


def heading(plan: DayPlan, site: Site, light: str) -> str:
    """Place, zone, sunrise and sunset, noon and the assumed irradiance, in one line."""
    noon = int(np.argmax(plan.elevation_deg))
    noon_ns = int(plan.time_ns[noon])
    return (
        f"site {formatting.place(site)} ({formatting.zone_name(noon_ns, site)}); "
        f"sun up {_sun_up(plan, site, noon)}, noon {formatting.clock_time(noon_ns, site)}, "
        f"el {plan.elevation_deg[noon]:.1f}°; {light}"
    )


def _sun_up(plan: DayPlan, site: Site, noon: int) -> str:
    """Sunrise and sunset around noon: ``06:42–16:29``, or ``all day``."""
    down = np.flatnonzero(plan.elevation_deg <= plan.settings.rising_deg)
    if not down.size:
        return "all day"
    rise = max(down[down < noon], default=-1) + 1
    sink = min(down[down > noon], default=plan.time_ns.size) - 1
    return "–".join(formatting.clock_time(int(plan.time_ns[minute]), site) for minute in (rise, sink))


def rows(plan: DayPlan, site: Site) -> list[Sequence[str]]:
    """One row per planned time for `COLUMNS`; values of the facets side by side."""
    table: list[Sequence[str]] = []
    bearing = np.degrees(np.arctan2(plan.sun[:, 0], plan.sun[:, 1]))
    for index, minute in enumerate(plan.rows):
        before_ns = int(plan.time_ns[plan.rows[max(index - 1, 0)]])
        at = formatting.clock_time(int(plan.time_ns[minute]), site, since_ns=before_ns)
        sun = f"{formatting.number(plan.elevation_deg[minute])}°", f"{round(bearing[minute]) % 360}°"
        irradiance = _beside(plan.sensitivity.irradiance_w_m2[:, minute], 1)
        kelvin = _beside(plan.sensitivity.temperature_k[:, minute], 2)
        table.append((at, *sun, irradiance, kelvin, plan.verdict(index)))
    return table


def _beside(values: Sequence[float] | np.ndarray, digits: int) -> str:
    return "  ".join(formatting.number(float(value), digits) for value in values)


def warnings(plan: DayPlan, site: Site) -> list[str]:
    """Warnings for that day, one sentence each."""
    paragraphs, twins = ([_no_window(plan)], []) if plan.best_minute() is None else ([], plan.twins())
    for index, facet in enumerate(plan.facets):
        if facet[0] > plan.settings.tilt_limit_deg:
            limit = f"estimator.tilt_limit_deg = {plan.settings.tilt_limit_deg:g}"
            paragraphs.append(f"{label(facet)} is steeper than {limit}: no estimate reaches it")
        intervals = plan.intervals(plan.weak[index])
        if intervals:
            paragraphs.append(
                f"the {label(facet)} region is weak {_when(plan, intervals, site)}: below "
                f"{WEAK_K_PER_DEG:.3f} K per °, 0.1 K between regions is more than 3° of tilt"
            )
    for facet, twin in zip(plan.facets, twins, strict=False):
        paragraphs.extend(_twin(plan, facet, twin))
    return paragraphs


def _no_window(plan: DayPlan) -> str:
    settings = plan.settings
    if plan.usable.any():
        return f"no {WINDOW_MIN} min determine any of these slopes"
    is_low = plan.elevation_deg.max() < settings.low_sun_deg
    why = f"the sun stays below {settings.low_sun_deg:g}°" if is_low else "the horizon hides the sun"
    return f"{why}: nothing can be measured"


def _twin(plan: DayPlan, facet: tuple[float, float], twin: tuple[float, float]) -> list[str]:
    tilt, azimuth = twin
    apart = angle_between_deg(normal(*facet), normal(tilt, azimuth))
    if not (tilt <= plan.settings.tilt_limit_deg and apart >= FLAT_DEG):
        return []
    turned = abs((azimuth - facet[1] + 180.0) % 360.0 - 180.0)
    remedies = [
        *([f"limit the tilt below {tilt:.0f}°"] if tilt > facet[0] + 1.0 else ()),
        *(["give the azimuth"] if turned > ASIDE_DEG else ()),
        "record for hours",
    ]
    return [
        f"{label(facet)} has a twin: {tilt:.0f}°/{round(azimuth) % 360}° fits the best {WINDOW_MIN} min as "
        f"well; {' or '.join(remedies)}"
    ]


def _when(plan: DayPlan, intervals: Sequence[tuple[int, int]], site: Site) -> str:
    """``before 09:30 and after 14:00``, to ten minutes; the ends of the usable day go without saying."""
    usable = plan.time_ns[plan.usable]
    parts = []
    for start, end in intervals:
        begin, finish = _to_ten_minutes(start, site), _to_ten_minutes(end, site)
        if start == usable[0] and end == usable[-1]:
            parts.append("all day")
        elif start == usable[0]:
            parts.append(f"before {finish}")
        elif end == usable[-1]:
            parts.append(f"after {begin}")
        else:
            parts.append(f"after {begin} (until {finish})")
    return " and ".join(parts)


def _to_ten_minutes(time_ns: int, site: Site) -> str:
    ten = 600_000_000_000
    return formatting.clock_time((time_ns + ten // 2) // ten * ten, site)


def footnotes(plan: DayPlan) -> list[str]:
    """The bias budget of the best minute, if there is one."""
    if plan.best_minute() is None:
        return []
    budget = ", ".join(
        f"{formatting.number(float(kelvin), 2)} K at {label(facet)}"
        for facet, kelvin in zip(plan.facets, plan.bias_budget_k(), strict=True)
    )
    return [f"camera bias budget for {plan.settings.bias_deg:g}° of tilt: {budget}"]


def page(plan: DayPlan, site: Site, title: str, light: str, session: Session | None = None) -> str:
    """The whole page: where and when, the session, warnings, chart, the day, checklist."""
    targets = ", ".join(label(facet) for facet in plan.facets)
    return render(
        "plan.html",
        title=title,
        heading=heading(plan, site, light),
        lead=session.summary if session else [_no_window(plan)],
        session=session and session.table,
        warnings=warnings(plan, site),
        charts=[_chart(plan, site, session)] if plotting.available() else None,
        over_day=Table(COLUMNS, rows(plan, site), f"Regions side by side: {targets}."),
        footnotes=footnotes(plan),
    )


def _chart(plan: DayPlan, site: Site, session: Session | None) -> Figure:
    below = "; below, half of the region of each tilt as the session goes on" if session else ""
    return Figure(
        _figure(plan, site, session),
        f"What one degree of tilt is worth over the day{below}.",
        "kelvin per degree over the day, and half widths over the session, one line per region",
        wide=True,
    )


def _figure(plan: DayPlan, site: Site, session: Session | None) -> str:
    figure, panels = plotting.panels(2 if session else 1, 4.6, plotting.WIDE_IN)
    upper, lower = panels[0], panels[-1]
    hours, usable = _hours(plan.time_ns, plan, site), plan.usable
    for index, facet in enumerate(plan.facets):
        line = plotting.line(index, label(facet))
        upper.plot(hours[usable], plan.sensitivity.temperature_k[index, usable], **line)
        if session:
            time_ns, halves = session.course
            lower.semilogy(_hours(time_ns, plan, site), halves[:, index], marker=".", **line)
    if session:
        lower.set_ylabel("tilt, half region, °")
        plotting.plain_log_ticks(lower.yaxis)
    upper.axhspan(-WEAK_K_PER_DEG, WEAK_K_PER_DEG, color="0.88", label="weak")
    upper.set_ylabel("K per ° of tilt")
    plotting.clock_ticks(lower)
    lower.set_xlabel(f"local time ({formatting.zone_name(_middle_ns(plan), site)})")
    plotting.legend(upper)
    return plotting.svg(figure)


def _hours(time_ns: IntArray, plan: DayPlan, site: Site) -> np.ndarray:
    """Hours since midnight, of the clocks at noon: they may have changed in the night before."""
    middle_ns = _middle_ns(plan)
    return np.asarray((formatting.of_day_ns(middle_ns, site) + time_ns - middle_ns) / 3.6e12)


def _middle_ns(plan: DayPlan) -> int:
    return int(plan.time_ns[plan.time_ns.size // 2])
