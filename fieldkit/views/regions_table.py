"""The live screen's table of regions: what each bed is now, and how far its slope may be trusted."""

from __future__ import annotations

import math

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from fieldkit.estimation.answers import CERTAIN
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.slope import SlopeEstimate
from fieldkit.views import picture, words
from fieldkit.views.latest import Latest

_FIRST_MINUTE = Text("first minute: brightness", "quiet")
NOISE_COLS, UNIT_COLS = 104, 112
"""Widths from which there is room for noise and given slope, and for the unit in the heading."""


def regions_table(latest: Latest, cols: int, lines: int) -> RenderableType:
    """The regions in `lines` below a heading; where they are too few the last one says how many are hidden.

    Temperatures are of the surface (°C), other than the picture's; until the first minute is over they
    are brightness temperatures.
    """
    wide = cols >= NOISE_COLS
    hidden = len(latest.regions) - lines
    shown = latest.regions if hidden <= 0 else latest.regions[: max(1, lines - 1)]
    gap = 2 if wide else 1
    table = Table(box=None, padding=(0, gap, 0, 0), pad_edge=False, expand=True, header_style="quiet")
    table.add_column("region", no_wrap=True, max_width=12)
    for name in (
        "surface °C" if cols >= UNIT_COLS else "surface",
        "spread",
        "tilt ±90 %",
        "azimuth ±",
        "K per °",
    ):
        table.add_column(name, no_wrap=True, justify="right", min_width=len(name))
    if wide:
        table.add_column("noise", no_wrap=True)
        table.add_column("given", no_wrap=True)
    table.add_column("state", no_wrap=True, overflow="ellipsis", ratio=1)
    for region in shown:
        cells = _region_cells(latest, region)
        more = [_noise(latest, region), words.given_slope(region)] if wide else []
        table.add_row(region.name, *cells[:-1], *more, cells[-1])
    if hidden <= 0:
        return table
    more_rows = len(latest.regions) - lines
    return Group(
        table,
        Text(
            f"{len(latest.regions) - len(shown)} more regions hidden: {more_rows} more rows show them",
            "doubt",
        ),
    )


def _region_cells(latest: Latest, region: Region) -> list[str | Text]:
    """Mean, spread, tilt, azimuth, kelvin per degree and state of one region."""
    minute = latest.minute
    if minute is None:
        return [*_as_seen(latest, region), words.UNKNOWN, words.UNKNOWN, words.UNKNOWN, _FIRST_MINUTE]
    mean, spread = (known.get(region.name, math.nan) for known in (minute.temperature_k, minute.spread_k))
    cells: list[str | Text] = [words.celsius(mean), words.number(spread, 2)]
    if region.kind is RegionKind.REFERENCE:
        azimuth = words.number(region.azimuth_deg) if region.tilt_deg else words.UNKNOWN
        return [*cells, words.number(region.tilt_deg, 1), azimuth, "", Text("reference", "quiet")]
    estimate = _estimate(latest, region)
    if estimate is None:
        return [*cells, words.UNKNOWN, words.UNKNOWN, words.UNKNOWN, words.UNKNOWN]
    return [
        *cells,
        words.tilt(estimate),
        words.azimuth(estimate),
        words.number(estimate.kelvin_per_degree, 2),
        Text(words.state(estimate), _state_style(estimate)),
    ]


def _estimate(latest: Latest, region: Region) -> SlopeEstimate | None:
    found = latest.minute.estimates if latest.minute else ()
    return next((estimate for estimate in found if estimate.region == region.name), None)


def _noise(latest: Latest, region: Region) -> str:
    estimate = _estimate(latest, region)
    return words.noise(estimate) if estimate else ""


def _as_seen(latest: Latest, region: Region) -> list[str | Text]:
    """Mean and spread in the last picture, until the first minute has a surface temperature."""
    frame = latest.frame
    if frame is None or picture.unit(latest.streams[frame.stream]) != "°C":
        return [words.UNKNOWN, words.UNKNOWN]
    shown = picture.values(frame, latest.streams[frame.stream])
    inside = shown[region.mask((shown.shape[0], shown.shape[1]))]
    if not np.isfinite(inside).any():
        return [words.UNKNOWN, words.UNKNOWN]
    return [words.number(float(np.nanmean(inside)), 2), words.number(float(np.nanstd(inside)), 2)]


def _state_style(estimate: SlopeEstimate) -> str:
    return "good" if estimate.state in CERTAIN else "doubt"
