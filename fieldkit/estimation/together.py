"""Sessions of one place as one estimate: the slopes that explain all of their minutes.

Regions are the same places where they have the same name; where a camera stood, and so their outlines, may
differ. What must not differ is what the estimate assumes to be one thing: the place, the references, the
settings. It is checked here, for sessions and for tables alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

from fieldkit.estimation.bins import History
from fieldkit.estimation.budget import BudgetTerm
from fieldkit.estimation.chain import Estimated, SlopeChain
from fieldkit.estimation.computed_reference import require_measured_reference
from fieldkit.estimation.settings import EstimatorSettings
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument, Text
from fieldkit.model.site import Region, RegionKind, Site, apart_m
from fieldkit.model.slope import ReferenceCheck

MOST_APART_M = 100.0
"""Between the sites of one place: twice what coordinates rounded to 0.001 degrees are off."""
OF_A_SESSION = frozenset(
    ("irradiance", "light_stream", "measures", "limits", "probes", "factor_sd", "site", "camera_path")
)
"""Settings that minute bins were made with, or that belong to a day: they may differ."""


@dataclass(frozen=True, slots=True)
class Part:
    """A session or table by its name in messages; `regions` are the columns of its history."""

    name: str
    site: Site
    regions: tuple[Region, ...]
    history: History
    settings: EstimatorSettings


@dataclass(frozen=True, slots=True)
class Together:
    """Slopes of all targets of the parts after the last minute, their uncertainty budgets by name, and the
    references' checks.
    """

    regions: tuple[Region, ...]
    history: History
    estimated: Estimated
    budgets: Mapping[str, tuple[BudgetTerm, ...]]
    checks: tuple[ReferenceCheck, ...]


def slopes_together(parts: Sequence[Part]) -> Together:
    """Slopes of parts of one place, by the learned model, in order of time.

    Slopes, gain, thermal inertia and what is unlike in a bed are learned from all parts; exchange, sky, air,
    temperatures in depth and the camera's offsets begin anew in each. A region that a part does not have is
    not measured there. Settings are those of the last part. Raises `ConfigError` if the parts are not of one
    place (more than `MOST_APART_M` apart, other references), overlap in time, or differ in their settings,
    and for a reference that was computed from the weather.
    """
    for part in parts:
        if not len(part.history):
            raise ConfigError("no minutes", place=part.name, fix="omit that session")
    parts = sorted(parts, key=lambda part: int(part.history.time_ns[0]))
    for before, after in pairwise(parts):
        _require_later(before, after)
    last = parts[-1]
    if last.settings.model != "learned" and last.settings.reference == "region":
        fix = 'set estimator.model = "learned"'
        raise ConfigError("only the learned model estimates sessions together", place=last.name, fix=fix)
    for part in parts[:-1]:
        _require_same_place(part, last)
        _require_same_settings(part, last)
    if last.settings.reference == "region":
        for part in parts:
            require_measured_reference(part.name, part.history, part.regions)
    regions = tuple({region.name: region for part in parts for region in part.regions}.values())
    places = {region.name: place for place, region in enumerate(regions)}
    histories = [
        part.history.spread([places[region.name] for region in part.regions], len(regions)) for part in parts
    ]
    chain = SlopeChain(regions, last.settings)
    last_history, estimated = histories[-1], chain.together(histories)
    return Together(regions, last_history, estimated, chain.budgets(last_history), chain.reference_checks())


def _require_later(before: Part, after: Part) -> None:
    end_ns, begin_ns = int(before.history.time_ns[-1]), int(after.history.time_ns[0])
    if begin_ns <= end_ns:
        problem = f"begins at {_utc(begin_ns)}, before {before.name} ends at {_utc(end_ns)}"
        raise ConfigError(problem, place=after.name, fix="omit one of them: each minute counts once")


def _utc(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M} UTC"


def _require_same_place(part: Part, other: Part) -> None:
    away_m = apart_m(part.site, other.site)
    if part.site.body != other.site.body or away_m > MOST_APART_M:
        problem = f"{away_m:.0f} m from {other.name}; one place is within {MOST_APART_M:g} m"
        fix: Text = "estimate them one by one, or correct a wrong site.latitude_deg"
        raise ConfigError(problem, place=part.name, fix=fix)
    if (mine := _references(part)) != (others := _references(other)):
        problem = f"other references: it has {_words(mine)}, {other.name} {_words(others)}"
        fix = "state the same names, tilts and azimuths in the campaign, then " + Argument("present", True)
        raise ConfigError(problem, place=part.name, fix=fix)
    kinds = {region.name: region for region in other.regions}
    for region in part.regions:
        same = kinds.get(region.name, region)
        if region.kind is not same.kind or abs(region.azimuth_deg - same.azimuth_deg) > 1e-6:
            raise ConfigError(
                f"not the same in {part.name} and {other.name}: azimuth {region.azimuth_deg:g}° and "
                f"{same.azimuth_deg:g}°",
                place=f"region {region.name}",
                fix="rename one of them: regions of one name must be one place",
            )


def _references(part: Part) -> dict[str, tuple[float, float]]:
    """Tilt and azimuth of each reference; without one it is level, and a level one has no azimuth."""
    references = (region for region in part.regions if region.kind is RegionKind.REFERENCE)
    tilts = ((region, 0.0 if math.isnan(region.tilt_deg) else region.tilt_deg) for region in references)
    return {region.name: (tilt, region.azimuth_deg if tilt else 0.0) for region, tilt in tilts}


def _words(references: Mapping[str, tuple[float, float]]) -> str:
    slopes = (f"{name} ({tilt:g}°, {azimuth:g}°)" for name, (tilt, azimuth) in sorted(references.items()))
    return ", ".join(slopes) or "none"


def _require_same_settings(part: Part, other: Part) -> None:
    if names := list(_differing("estimator", part.settings, other.settings)):
        fix = "give both one value, or those of the campaign: " + Argument("present", True)
        raise ConfigError(f"differs from {other.name} in {', '.join(names)}", place=part.name, fix=fix)


def _differing(table: str, one: Any, other: Any) -> Iterator[str]:
    """Keys whose values differ."""
    for name in (field.name for field in fields(one) if field.name not in OF_A_SESSION):
        mine, others = getattr(one, name), getattr(other, name)
        if is_dataclass(mine):
            yield from _differing(name, mine, others)
        elif mine != others:
            yield f"{table}.{name}"
