"""What the trials of calibrations share: commands run in this process, and sessions made differently."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from fieldkit.commands import main
from fieldkit.commands.demo import mean_tilt_error_deg
from fieldkit.commands.estimating import config_for, estimator_for, minutes_of
from fieldkit.config.template import SIMULATED, campaign_toml
from fieldkit.samples import Sample
from fieldkit.sessions.exchange.imported import Foreign, write_foreign
from fieldkit.sessions.reader import open_session

TRUE_EMISSIVITY = 0.80
FAST = ("--set", "simulation.speed=max", "--set", f"simulation.emissivity={TRUE_EMISSIVITY}")


def fieldkit(*arguments: str | Path, code: int = 0) -> Result:
    found = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert found.exit_code == code, found.output
    return found


def record_beds(folder: Path, **given: Any) -> Result:
    """Record 75 minutes of three beds in a campaign of their own in `folder`."""
    tables = {**SIMULATED, "estimator": {"model": "full", "azimuth": "known"}, **given}
    (folder / "fieldkit.toml").write_text(campaign_toml(tables), encoding="utf-8")
    return fieldkit("record", "-C", folder, "--for", "75m", "--name", "three-beds", *FAST, "--no-color")


def mean_error_deg(session: Path, *settings: str) -> float:
    with open_session(session) as opened:
        estimator = estimator_for(opened, config_for(opened, settings))
        return mean_tilt_error_deg(list(minutes_of(opened, estimator)), estimator.regions)


def rewritten(source: Path, to: Path, change: Callable[[Sample], Sample]) -> Path:
    """The session once more, each sample as `change` makes it."""
    with open_session(source) as session:
        header = session.header
        samples = sorted((change(one) for one in session.samples()), key=lambda one: one.time_ns)
    clockless = (one._replace(mono_ns=one.time_ns) for one in samples)
    write_foreign(to, header, Foreign(header.streams, list(clockless)), str(source))
    return to
