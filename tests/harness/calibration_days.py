"""What the trials of calibrations share: commands run in this process, and sessions made differently."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
from click.testing import Result

from fieldkit.config.template import SIMULATED, campaign_toml
from fieldkit.model.samples import Sample
from fieldkit.results.minutes import SessionMinutes
from fieldkit.results.sources import config_for
from fieldkit.sessions.formats.imported import ImportedRecording, write_imported
from fieldkit.sessions.reader import open_session
from fieldkit.views.report.assessment import mean_error
from fieldkit.views.report.series import series
from tests.harness import command_line
from tests.harness.seldom import SET_SELDOM

TRUE_EMISSIVITY = 0.80
FAST = ("--set", "simulation.speed=max", "--set", f"simulation.emissivity={TRUE_EMISSIVITY}")


def fieldkit(*arguments: str | Path, code: int = 0) -> Result:
    found = command_line.fieldkit(*arguments)
    assert found.exit_code == code, found.output
    return found


def calibrated(*words: str | Path) -> dict[str, Any]:
    """The document of ``fieldkit calibrate WORDS --json``."""
    document: dict[str, Any] = command_line.document("calibrate", *words)
    return document


def record_beds(folder: Path, **given: Any) -> Result:
    """Record 75 minutes of three beds, meters read every 4 s, in a campaign of their own in `folder`."""
    tables = {**SIMULATED, "estimator": {"model": "full", "azimuth": "known"}, **given}
    (folder / "fieldkit.toml").write_text(campaign_toml(tables), encoding="utf-8")
    words = ("--for", "75m", "--name", "three-beds", *FAST, *SET_SELDOM, "--no-color")
    return fieldkit("record", "-C", folder, *words)


def mean_error_deg(session: Path, *settings: str) -> float:
    with open_session(session) as opened:
        minutes = SessionMinutes(opened, config_for(opened, settings))
        return mean_error(series(minutes.minutes(), minutes.regions))


def rewritten(source: Path, to: Path, change: Callable[[Sample], Sample]) -> Path:
    """The session once more, each sample as `change` makes it."""
    with open_session(source) as session:
        header = session.header
        samples = sorted((change(one) for one in session.samples()), key=lambda one: one.time_ns)
    clockless = (one._replace(mono_ns=one.time_ns) for one in samples)
    write_imported(to, header, ImportedRecording(header.streams, list(clockless)), str(source))
    return to


def found_with_damage(session: Path, folder: Path, dataset: str, *command: str) -> list[dict[str, Any]]:
    """What a calibration finds where ten readings were halved, and where they were doubled."""
    found = []
    for factor in (0.5, 2.0):
        (folder / f"{factor}").mkdir()
        copy = folder / f"{factor}" / session.name
        copy.write_bytes(session.read_bytes())
        with h5py.File(copy, "r+") as file:
            middle = len(file[dataset]) // 2
            file[dataset][middle : middle + 10] = factor * file[dataset][middle : middle + 10]
        said = calibrated(command[0], copy, *command[1:])
        found.append({key: said[key] for key in said.keys() - {"sources", "record"}})
    return found
