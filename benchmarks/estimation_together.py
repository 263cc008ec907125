"""Two sessions of one field estimated together, against the later one alone.

Fields of `benchmarks.drawn_worlds` visited twice, an hour each, with other offsets and noise of the camera:
on two days of one declination, and at the solstice and in late August. Wind and air are logged.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.drawn_worlds import AUGUST, CLEAR, DAY_NS, JUNE, RANDOM, SOUTH, World, drawn_world
from benchmarks.ok_counts import ok_words
from benchmarks.result import Result
from fieldkit.estimation.chain import SlopeChain
from fieldkit.estimation.together import Part, slopes_together
from fieldkit.model.slope import SlopeEstimate

WORLDS = int(os.environ.get("FIELDKIT_WORLDS", "8"))
MINUTES = 60
PLACES = (
    ("one declination, south, known", CLEAR, CLEAR, SOUTH),
    ("June and August, random, free", JUNE, AUGUST, RANDOM),
)
Slopes = Sequence[SlopeEstimate]


def visits(seed: int, first_day: str, second_day: str, beds: str, minutes: int = MINUTES) -> list[World]:
    """A field twice; two visits of one day are a day apart."""
    first, second = (
        drawn_world(seed, day, beds, minutes=minutes, visit=number)
        for number, day in enumerate((first_day, second_day), start=1)
    )
    if first_day == second_day:
        minute, time_ns = second.history.minute + 1440, second.history.time_ns + DAY_NS
        second = replace(second, history=replace(second.history, minute=minute, time_ns=time_ns))
    return [replace(world, settings=replace(world.settings, model="learned")) for world in (first, second)]


def as_part(world: World) -> Part:
    """A visit as a part of a joined estimate."""
    site = world.settings.site
    assert site is not None
    name = str(np.datetime64(int(world.history.time_ns[0]), "ns").astype("datetime64[D]"))
    return Part(name, site, world.regions, world.history, world.settings)


def alone_and_together(worlds: Sequence[World]) -> tuple[Slopes, Slopes]:
    """Slopes by the last visit alone, and by all of them."""
    last = worlds[-1]
    alone = SlopeChain(last.regions, last.settings).at_once(last.history).slopes
    return alone, slopes_together([as_part(world) for world in worlds]).estimated.slopes


def half_widths(slopes: Slopes) -> list[float]:
    """Half widths of the tilts' regions. [degrees]."""
    return [slope.tilt_half_width_deg for slope in slopes]


def run() -> list[Result]:
    """All rows; a world takes a minute of processor time."""
    return [row for place in PLACES for row in _rows(*place)]


def _rows(name: str, first_day: str, second_day: str, beds: str) -> Iterator[Result]:
    widths: list[tuple[float, float]] = []
    errors: list[list[float]] = []
    inside: list[bool] = []
    all_slopes: list[SlopeEstimate] = []
    for seed in range(WORLDS):
        worlds = visits(seed, first_day, second_day, beds)
        alone, together = alone_and_together(worlds)
        all_slopes += together
        widths += zip(half_widths(alone), half_widths(together), strict=True)
        truths = {region.name: region.tilt_deg for region in worlds[0].regions}
        errors += [
            [abs(slope.tilt_deg - truths[slope.region]) for slope in pair]
            for pair in zip(alone, together, strict=True)
        ]
        inside += [slope.tilt_low_deg <= truths[slope.region] <= slope.tilt_high_deg for slope in together]
    before, after = np.mean(widths, axis=0)
    was, now = np.mean(errors, axis=0)
    about = f"{WORLDS} worlds; the second hour alone ±{before:.2f}°, error {was:.2f}°"
    yield Result(f"{name}: half width of the region, mean", float(after), "°", "smaller", about)
    yield Result(f"{name}: mean tilt error", float(now), "°", "reported", about)
    held = 100.0 * float(np.mean(inside))
    yield Result(f"{name}: regions hold the truth", held, "%", ">= 85", ok_words(all_slopes))
