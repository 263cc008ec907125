"""An emissivity day with the instruments at hand: a recording that says when the surface is steady.

The day is recorded like any session, with a burst of pictures a minute and a shutter correction before
each; this view looks on. What is worked out afterwards comes from the session alone.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from fieldkit.calibration.emissivity import MIN_SPAN_K
from fieldkit.calibration.steady_pairs import STEADY_K_MIN, drift_k_min, steady_stretches
from fieldkit.cli import common
from fieldkit.cli.calibrate_gather import Gathering, Setup
from fieldkit.cli.calibrate_setup import setup_of
from fieldkit.cli.record import run_until_stopped
from fieldkit.estimation.estimator import Minute
from fieldkit.model.errors import CalibrationError
from fieldkit.model.samples import Frame, Reading
from fieldkit.model.units import CELSIUS_ZERO_K
from fieldkit.recorder.recorder import Shown
from fieldkit.workflows.record import prepare

BURSTS = (
    "record.sampling=bursts",
    "record.every_s=60.0",
    "record.burst_frames=25",
    "record.shutter_before_burst=true",
)
APART_K = 5.0
"""Steady temperatures closer than this count as one."""


def record_emissivity(
    ctx: click.Context, sample: str, given: dict[str, Any], settings: Sequence[str]
) -> Path:
    """Record until enough steady temperatures were seen, the time is over, or Ctrl-C; the session."""
    config = common.campaign(ctx, (*BURSTS, *settings))
    with prepare(config, name=sample, duration_s=given["lasting"], notify=common.say_warning) as prepared:
        setup = setup_of(prepared.instruments.streams, config.regions, given, config.path)
        _introduce(setup)
        prepared = prepared.starting_now()
        span_k = MIN_SPAN_K if given["reflected"] == "free" else 0.0
        watch = SteadyView(Gathering(setup), given["temperatures"], span_k)
        summary = run_until_stopped(prepared, [watch]).summary
    if summary.failure is not None:
        raise summary.failure
    common.say(f"recorded {prepared.path}")
    return prepared.path


def _introduce(setup: Setup) -> None:
    mirror = (
        f"foil in region {setup.foil.name}, in the sample's plane"
        if setup.foil
        else "reflected temperature given"
    )
    probe = f"tape in region {setup.tape.name}" if setup.tape else (
        f"probe {setup.channel_names[setup.channel]} under one layer of grains in region {setup.sample.name}"
    )  # fmt: skip
    common.say(f"1  {mirror}\n2  {probe}\n3  wait until each temperature is steady; Ctrl-C when done")
    if sys.stdin.isatty() and not common.options().no_input:
        click.pause("press a key when both are in place", err=True)


@dataclass
class SteadyView:
    """Says every minute how steady the surface is and how many temperatures there are; ends when enough."""

    gathering: Gathering
    wanted: int
    wanted_span_k: float = 0.0

    def show(self, item: Shown) -> None:
        """See `fieldkit.recorder.View`."""
        if isinstance(item, Frame | Reading):
            self.gathering.add(item)
        elif isinstance(item, Minute):
            self._look()

    def close(self) -> None:
        """Nothing to let go of."""

    def _look(self) -> None:
        try:
            readings = self.gathering.readings()
        except CalibrationError as error:
            common.say(f"   {error.message}" + (f"; {error.fix}" if error.fix else ""))
            return
        now_ns = int(readings.contact_ns[-1])
        recent = readings.contact_ns > now_ns - 120_000_000_000
        drift = drift_k_min(readings.contact_ns[recent], readings.contact_k[recent])
        steady = [stretch.contact_k for stretch in steady_stretches(readings)]
        temperatures = apart(steady)
        state = "steady" if abs(drift) < STEADY_K_MIN else "wait"
        span = max(steady, default=0.0) - min(steady, default=0.0)
        probe, apparent, mirrored = (
            f"{float(values[-1]) - CELSIUS_ZERO_K:5.1f} °C"
            for values in (readings.contact_k, readings.apparent_k, readings.reflected_k)
        )
        common.say(
            f"   probe {probe}  {drift:+.2f} K/min {state:6}   apparent {apparent}   reflected {mirrored}"
            f"   temperatures {len(temperatures)} of {self.wanted}, span {span:.0f} K"
        )
        if len(temperatures) >= self.wanted and span >= self.wanted_span_k:
            signal.raise_signal(signal.SIGTERM)  # what fieldkit stop does: the recorder seals and ends


def apart(steady_k: Sequence[float]) -> list[float]:
    """Those of the steady temperatures that differ, in order of time."""
    found: list[float] = []
    for one in steady_k:
        if all(abs(one - other) >= APART_K for other in found):
            found.append(one)
    return found
