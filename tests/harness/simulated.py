"""Recordings of the simulated field in this process, as fast as it can be computed, by the paper's model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fieldkit.config import FILE_NAME, Config, load_config
from fieldkit.config.template import SIMULATED
from fieldkit.recording.background import RecordOptions
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.record import RecordedSession, prepare
from tests.harness.seldom import SELDOM

PAPER = ('estimator.model="paper"', 'estimator.azimuth="known"')


def simulated_config(folder: Path, *settings: str, tables: dict[str, Any] = SIMULATED) -> Config:
    """The configuration of a campaign of its own, which is made in `folder`."""
    create_campaign(folder, tables)
    return load_config(folder / FILE_NAME, settings=settings)


def record_simulated(
    folder: Path, minutes: float, *settings: str, tables: dict[str, Any] = SIMULATED
) -> RecordedSession:
    """Record in such a campaign; meters are read every 4 s."""
    config = simulated_config(folder, "simulation.speed=max", *PAPER, *SELDOM, *settings, tables=tables)
    with prepare(config, RecordOptions(duration_s=60.0 * minutes)) as prepared:
        return prepared.run()
