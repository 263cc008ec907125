"""The sessions to compare: each checkout records its own, with the same seeds and clocks."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.same.program import Program

RECORDED: dict[str, Sequence[str]] = {
    "demo": ("estimator.azimuth=known",),
    "free": ("estimator.azimuth=free",),
    "paper": ("estimator.model=paper", "estimator.window_s=600"),
    "full": ("estimator.model=full", "estimator.window_s=600"),
    "faults": ('simulation.faults=["cloud","cable","shutter","garbled","shade"]',),
    "clock": ('simulation.faults=["clock","drift","overrange"]',),
    "horizon": ("site.horizon=[[0,5],[150,5],[160,40],[180,40],[190,5]]",),
    "moving": ("simulation.drift_px=[4.0,3.0]", "simulation.jitter_px=1.0"),
    "night": ("simulation.start=2016-01-01T16:20:00-07:00",),
}
"""Settings of each recording of simulated instruments."""
MINUTES = 40


def make(program: Program, folder: Path, only: str) -> Iterator[Path]:
    """Fill `folder` with the sessions and tables whose name contains `only`; each path as it is finished."""
    for name, settings in RECORDED.items():
        if only in name or (name, only) == ("demo", "imported"):  # imports are merged into the demo
            yield record(program, folder / name, settings, MINUTES)
    if only in "imported":
        yield from imported(program, folder / "imported", folder / "demo")
    if only in "two-days":
        folder.mkdir(exist_ok=True)
        yield two_days(folder / "two-days.csv")


def record(program: Program, campaign: Path, settings: Sequence[str], minutes: int) -> Path:
    """A sealed session of a new campaign of simulated instruments."""
    start(program, campaign)
    options = [word for setting in ("simulation.speed=max", *settings) for word in ("--set", setting)]
    printed = program.run("record", "--for", f"{minutes}m", "--name", "same", *options, cwd=campaign)
    sessions = sorted(campaign.glob("recordings/*.h5"))
    if len(sessions) != 1:
        raise SystemExit(f"{campaign.name} was not recorded: {printed}")
    return sessions[0]


def start(program: Program, campaign: Path) -> None:
    """A new campaign of simulated instruments."""
    campaign.mkdir(parents=True)
    program.run("init", "--simulated", ".", cwd=campaign)


def imported(program: Program, campaign: Path, recorded: Path) -> Iterator[Path]:
    """A logger's table alone, and merged into a recording."""
    start(program, campaign)
    session = next(recorded.glob("recordings/*.h5"))
    table = campaign / "logger.csv"
    rows = (
        f"2016-01-01T{12 + n // 60}:{n % 60:02}:00-07:00,{1.5 + n / 100:.2f},{400 + n}" for n in range(45)
    )
    table.write_text("\n".join(["time,air (C),ghi (W/m2)", *rows, ""]))
    program.run("import", table, "-o", "logger.h5", cwd=campaign)
    yield campaign / "logger.h5"
    program.run("import", table, "--into", session, "-o", "merged.h5", cwd=campaign)
    yield campaign / "merged.h5"


def two_days(path: Path) -> Path:
    """A table of temperatures of two days, for `estimate TABLE`; its numbers need not be true."""
    rows = ["time,reference_k,b20_k,ghi_w_m2,irradiance_w_m2,air_k"]
    for day in (1, 2):
        for minute in range(0, 360, 2):
            height = math.sin(math.pi * (minute + 30) / 420)
            noise = random.Random(1000 * day + minute).gauss(0.0, 0.05)
            flat, bed = 285.0 + 12.0 * height, 285.0 + 18.0 * height + noise
            rows.append(
                f"2016-06-{day:02}T{9 + minute // 60:02}:{minute % 60:02}:00-07:00,{flat:.3f},{bed:.3f},"
                f"{900 * height:.1f},{820 * height**0.3:.1f},{280 + 6 * height:.2f}"
            )
    path.write_text("\n".join([*rows, ""]))
    return path
