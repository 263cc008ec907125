"""Ten kinds of bad data, each from a session of twenty minutes in which its fault is simulated."""

from __future__ import annotations

import numpy as np
from demo_day import DemoDay

from fieldkit import open_session
from fieldkit.model.fault_kind import FaultKind
from fieldkit.results.session import Session
from fieldkit.views import plotting

UNSEEN = (FaultKind.DISK, FaultKind.CLOCK, FaultKind.SILENT)
"""No data are bad with the first two; a camera that is silent looks like one that is unplugged."""
SETTINGS = {kind: f'simulation.faults=["{kind}"]' for kind in FaultKind if kind not in UNSEEN} | {
    "jitter": "simulation.jitter_px=4"
}
"""What makes each kind of bad data."""
OFTEN = (
    "simulation.speed=max",
    "record.every_s=10",
    "record.burst_frames=1",
    "record.shutter_before_burst=false",
)
"""A frame in ten seconds, so that a minute's fault is seen."""
FIRST_FRAMES = 30
EACH = 6
"""Of so many light readings one is drawn: a dot costs a hundred bytes."""
IMAGES = tuple(f"fault-{name}.svg" for name in SETTINGS)


def as_recorded(session: Session) -> str:
    """How each region differs from its first minutes, and the light, as SVG text."""
    figure, (above, below) = plotting.panels(2, 3.4)
    series = session["camera"].region_series()
    change_k = series.mean_k - np.nanmean(series.mean_k[:FIRST_FRAMES], axis=0)
    dots = {"linestyle": "none", "markersize": 2.0}
    for index, (region, values) in enumerate(zip(series.regions, change_k.T, strict=True)):
        above.plot(plotting.days(series.time_ns), values, **plotting.marks(index, region) | dots)
    above.set_ylabel("change, K")
    plotting.legend(above)
    lux = session["lux"]
    klx = np.asarray(lux.readings().values)[::EACH, 0] / 1000.0
    below.plot(plotting.days(lux.times_ns()[::EACH]), klx, **plotting.marks(0, "light") | dots)
    below.set_ylabel("light, klx")
    below.margins(y=0.5)
    plotting.local_axis(below, session.site, lux.times_ns())
    return plotting.svg(figure)


def main(day: DemoDay) -> None:
    """Record a session of each kind, and draw it."""
    folder = day.folder / "faults"
    day.run("init", "--simulated", folder.name, "-q")
    for (name, setting), image in zip(SETTINGS.items(), IMAGES, strict=True):
        settings = [word for text in (*OFTEN, setting) for word in ("--set", text)]
        day.run("record", "-q", "--for", "20m", "--name", name, *settings, within=folder)
        with open_session(next((folder / "recordings").glob(f"*{name}.h5"))) as session:
            (day.images / image).write_text(as_recorded(session), encoding="utf-8")
