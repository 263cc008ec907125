"""What looks at what on an emissivity day, from the words of the command line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fieldkit.calibration.band import FLAT, Band, CameraBand, ResponseBand
from fieldkit.cli.calibrate_gather import Setup
from fieldkit.cli.calibrating import one_region
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region, RegionKind
from fieldkit.model.units import CELSIUS_ZERO_K

NOT_MEASURED_K = 150.0
"""Stands for the reflected temperature where the fit is to find it: colder than any sky."""


def setup_of(
    streams: Sequence[StreamInfo], regions: Sequence[Region], given: dict[str, Any], where: Path
) -> Setup:
    """What looks at what; raises `ConfigError` where that cannot be told."""
    camera = next((info for info in streams if info.is_camera), None)
    if camera is None:
        raise ConfigError(f"{where} has no camera", fix="emissivity needs pictures")
    reference = next((one.name for one in regions if one.kind is RegionKind.REFERENCE), "")
    sample = one_region(regions, given["region"] or reference, where)
    tape = one_region(regions, given["tape"], where) if given["tape"] else None
    foil, reflected_k = _reflected(given["reflected"], regions, where)
    setup = Setup(
        camera, sample, band_of(given["band"]), foil=foil, tape=tape, reflected_k=reflected_k,
        tape_emissivity=given["tape_emissivity"], foil_emissivity=given["foil_emissivity"],
        fahrenheit=given["unit"] == "F",
        camera_emissivity=_applied(camera, given["camera_emissivity"]),
        camera_reflected_k=given["camera_reflected"] + CELSIUS_ZERO_K,
        distance_m=given["distance"], air_k=given["air"] + CELSIUS_ZERO_K, humidity=given["humidity"] / 100.0,
    )  # fmt: skip
    if tape is not None:
        return setup
    found = [info for info in streams if info.quantity == "temperature"]
    named = [info for info in found if given["thermometer"] in (None, info.name)]
    if len(named) != 1:
        have = ", ".join(info.name for info in found) or "none"
        raise ConfigError(f"{where}: which thermometer?", fix=f"--thermometer; it has {have}")
    setup = replace(setup, thermometer=named[0])
    return replace(setup, channel=_channel(setup, given["channel"]))


def _applied(camera: StreamInfo, given: float | None) -> float:
    """The emissivity that the camera applied: what it says itself, or what somebody read off it."""
    told = float(camera.settings.get("emissivity", 1.0))
    if given is not None and told not in (1.0, given):
        raise ConfigError(
            f"the camera says it applied {told:g}, --camera-emissivity says {given:g}",
            fix="leave --camera-emissivity out: an emissivity must not be taken out twice",
        )
    return told if given is None else given


def _reflected(text: str, regions: Sequence[Region], where: Path) -> tuple[Region | None, float]:
    """The foil's region or the reflected temperature in kelvin."""
    if text == "free":
        return None, NOT_MEASURED_K
    try:
        return None, float(text) + CELSIUS_ZERO_K
    except ValueError:
        return one_region(regions, text, where), math.nan


def _channel(setup: Setup, text: str | None) -> int:
    names = setup.channel_names
    if text is None:
        return 0
    if text in names:
        return names.index(text)
    if text.isdigit() and 1 <= int(text) <= len(names):
        return int(text) - 1
    raise ConfigError(f"the thermometer has no probe {text!r}", fix=f"it has {', '.join(names)}")


def band_of(text: str) -> Band:
    """``8-14``, a file of wavelength and response, ``B,F`` or ``R,B,F,O``."""
    if text == "8-14":
        return FLAT
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        return ResponseBand.read(Path(text))
    if len(numbers) == 2:
        return CameraBand(*numbers)
    if len(numbers) == 4:
        return CameraBand(numbers[1], numbers[2], numbers[0], numbers[3])
    raise ConfigError(f"{text!r} is no band", fix="8-14, a file, B,F or R,B,F,O")
