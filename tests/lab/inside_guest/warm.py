"""Load what the commands of fieldkit need, once for all of their forks."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import time

HEAVY = (
    "numpy", "cv2", "h5py", "scipy.interpolate", "scipy.optimize", "erfa", "rich.live",
    "serial", "usb.backend.libusb1", "fieldkit.views.terminal_view", "fieldkit.recording.record",
    "fieldkit.results.estimate",
)  # fmt: skip
ROOMS = ("config", "drivers", "drivers.cameras", "drivers.meters", "estimation", "recorder", "sessions")
COMMANDS = ("check", "devices", "doctor", "record", "recover", "show")


def warm(place: tuple[float, float, float]) -> None:
    """Import the modules, and compute the sun's position at a place: latitude, longitude, elevation."""
    rooms = [importlib.import_module(f"fieldkit.{room}") for room in ROOMS]
    inside = (m.name for room in rooms for m in pkgutil.iter_modules(room.__path__, f"{room.__name__}."))
    commands = (f"fieldkit.cli.{command}" for command in COMMANDS)
    for name in (*HEAVY, *inside, *commands):
        with contextlib.suppress(ImportError):  # needs an extra the guest lacks, such as matplotlib
            importlib.import_module(name)
    _load_sun_tables(*place)


def _load_sun_tables(latitude_deg: float, longitude_deg: float, elevation_m: float) -> None:
    """The first position of the sun reads a large text file, which takes seconds of emulated time."""
    from fieldkit.model.site import Site
    from fieldkit.physics.sun import sun_vectors

    sun_vectors(time.time_ns(), Site(latitude_deg, longitude_deg, elevation_m))
