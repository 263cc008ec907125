"""Simulate a session: make a campaign of simulated instruments and record it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

from fieldkit.config import FILE_NAME, Config, load_config
from fieldkit.config.template import SIMULATED
from fieldkit.estimation.estimator import Minute
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.record import record
from fieldkit.results.session import Session

PAPER_WINDOW_S = 1200.0
"""The paper estimates over 20 minutes; the report compares its model with the learned one."""


def simulate(
    folder: str | Path | None = None,
    *,
    beds: Mapping[str, tuple[float, float]] | None = None,
    day: str = "clear",
    duration: str | float = "20m",
    seed: int = 1,
    drawn: bool = False,
    on_minute: Callable[[Minute], None] | None = None,
) -> Session:
    """Record a session on simulated instruments, as fast as possible; the session, open for reading.

    Parameters
    ----------
    folder
        Where the campaign is created; a temporary folder by default, which is not removed.
    beds
        Up to three beds of sand by name: tilt from horizontal and azimuth of the surface normal from north,
        clockwise. [degrees] By default 5, 15 and 25 degrees to the south. A flat reference lies beside them.
    day
        ``"clear"`` for a clear-sky model, ``"alamosa-2016-01-01"`` for the measured day that comes with
        fieldkit, or a SURFRAD or BSRN file of the station at the campaign's site.
    duration
        Scene time: ``"20m"``, ``"3h"``, or a number of seconds.
    seed
        Of all noise: the same seed gives the same session.
    drawn
        Whether the seed also draws sand, heat exchange, gusts, sky and the light meter's error, as they
        vary on measured ground; ``fieldkit.simulation.drawn_field.drawn_field(seed)`` has the truth.
    on_minute
        Called with each minute as it closes.

    Raises
    ------
    ConfigError
        Too many beds, an invalid slope, or an unknown day.
    RefusedError
        The folder is a campaign already.

    Examples
    --------
    >>> session = fieldkit.simulate("steep", beds={"steep": (30.0, 180.0)}, duration="3m")
    >>> [(region.name, region.tilt_deg) for region in session.regions]
    [('flat', 0.0), ('steep', 30.0)]
    """
    where = Path(tempfile.mkdtemp(prefix="fieldkit-")) if folder is None else Path(folder)
    simulation = {**SIMULATED["simulation"], "weather": day, "speed": "max", "seed": seed, "drawn": drawn}
    tables = {**SIMULATED, "region": _region_tables(beds), "simulation": simulation}
    return record(create_campaign(where, tables), duration=duration, name="simulated", on_minute=on_minute)


def _region_tables(beds: Mapping[str, tuple[float, float]] | None) -> list[Mapping[str, Any]]:
    """The usual flat reference, and the given beds in the usual places."""
    flat, *usual = SIMULATED["region"]
    if beds is None:
        return [flat, *usual]
    if len(beds) > len(usual):
        raise ConfigError(
            f"{len(beds)} beds do not fit the frame", place=Argument("beds"), fix=f"give at most {len(usual)}"
        )
    return [flat] + [
        {**place, "name": name, "tilt_deg": float(tilt_deg), "azimuth_deg": float(azimuth_deg)}
        for place, (name, (tilt_deg, azimuth_deg)) in zip(usual, beds.items(), strict=False)
    ]


PROBES_EVERY_S = 10.0
KNOWN_BED = "b15"
"""Bed of the demo whose slope is stated: it shows the gain, and the others check it."""


def demo_campaign(folder: Path, *, speed: float | Literal["max"], fault: str | None = None) -> Config:
    """The demo's campaign, created if it does not exist, with speed and fault of this run."""
    if not (folder / FILE_NAME).exists():
        estimator = {"azimuth": "known", "window_s": PAPER_WINDOW_S}
        kinds: dict[str, dict[str, str]] = {KNOWN_BED: {"kind": "reference"}}
        regions = [{**region, **kinds.get(region["name"], {})} for region in SIMULATED["region"]]
        # probes in sand change slowly, and every reading takes its time
        thermometer = {**SIMULATED["thermometer"], "every_s": PROBES_EVERY_S}
        stated = {"estimator": estimator, "surface": {"same": True}, "region": regions}
        create_campaign(folder, {**SIMULATED, **stated, "thermometer": thermometer})
    settings = [f"simulation.speed={speed}"]
    if fault is not None:
        settings.append(f'simulation.faults=["{fault}"]')
    return load_config(folder / FILE_NAME, settings=settings)
