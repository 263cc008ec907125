"""From suggested regions to the slopes of what they cover: by command, page and Python."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fieldkit
from fieldkit.config.template import SIMULATED
from fieldkit.model.errors import NoAnswerError
from fieldkit.model.site import Region, RegionKind
from fieldkit.recording import simulated_scene
from fieldkit.recording.campaign import Campaign, create_campaign
from fieldkit.recording.suggesting import suggest_regions
from fieldkit.results.describe import recorded_slopes
from fieldkit.simulation.scene import BEDS
from tests.harness.command_line import document, succeed
from tests.harness.page import served

NEAR = (
    replace(BEDS[0], points_px=((10, 20), (69, 20), (69, 99), (10, 99))),
    replace(BEDS[3], points_px=((90, 20), (149, 20), (149, 99), (90, 99))),
)
"""Beds of 6 x 8 pixels in a frame of 16 x 12, the flat one first."""
WITHIN_DEG, WITHIN_SHARE = 2.0, 0.25
"""Of ten minutes, whose regions are wide: beds of 5, 15 and 25 degrees are distinguished."""


def campaign(folder: Path, width: int, height: int) -> Campaign:
    """A simulated campaign without regions, with a camera of that size and 0.1 K of noise in a pixel."""
    options = {"width": width, "height": height, "kelvin_per_count": 0.01}
    camera = {"driver": "y16", "port": "simulated", "width_px": width, "height_px": height}
    seldom = {name: SIMULATED[name] | {"every_s": 4} for name in ("lux", "thermometer")}
    simulation = SIMULATED["simulation"] | {"speed": "max"}
    tables = {"camera": camera | {"options": options}, "simulation": simulation, "region": [], **seldom}
    return create_campaign(folder, {**SIMULATED, **tables})


def assert_true_slopes(
    slopes: Sequence[Mapping[str, Any]], regions: Sequence[Region], size: tuple[int, int], beds=BEDS
) -> None:
    """Every bed but the level one has a region with its slope, and the reference is the level one."""
    middles = {
        region.name: np.mean(region.points_px, axis=0) * np.divide((160, 120), size) for region in regions
    }
    under = {
        name: min(beds, key=lambda bed: np.hypot(*(np.mean(bed.points_px, axis=0) - middle)))
        for name, middle in middles.items()
    }
    reference = next(region.name for region in regions if region.kind is RegionKind.REFERENCE)
    assert under[reference].tilt_deg == 0.0
    assert {bed.name for bed in under.values()} == {bed.name for bed in beds}
    assert {slope["region"] for slope in slopes} == under.keys() - {reference}
    for slope in slopes:
        tilt_deg = under[slope["region"]].tilt_deg
        assert slope["tilt_deg"] == pytest.approx(tilt_deg, abs=WITHIN_DEG, rel=WITHIN_SHARE)


def test_by_command(tmp_path):
    size = (160, 120)
    folder = campaign(tmp_path / "c", *size).config.directory
    succeed("roi", "suggest", "--accept", "-C", folder)
    assert document("roi", "check", "-C", folder)["ok"]
    recorded = succeed("record", "--for", "10m", "-C", folder)
    assert "warning" not in recorded.stderr
    (path,) = (folder / "recordings").glob("*.h5")
    checked = document("roi", "check", "-C", folder, "--session", path)["regions"]
    assert [region["level"] for region in checked] == ["ok"] * 4
    slopes = document("estimate", path)["slopes"]
    assert_true_slopes(slopes, fieldkit.open_campaign(folder).regions, size)


def test_by_page(tmp_path):
    size = (32, 24)
    folder = campaign(tmp_path / "c", *size).config.directory
    succeed("record", "--for", "10m", "-C", folder)
    with served(folder) as page, page.browser() as browser:
        (listed,) = browser.request(do="sessions")["data"]
        for region in browser.request(do="suggest_regions", session=listed["id"])["data"]:
            outline = {key: region[key] for key in ("name", "kind", "points_px")}
            check = browser.request(do="check_region", region=outline, session=listed["id"])["data"]
            assert check["level"] == "ok", check
            assert browser.request(do="add_region", region=outline)["ok"]
        slopes = browser.request(do="estimate_session", session=listed["id"])["data"]
    assert_true_slopes(slopes, fieldkit.open_campaign(folder).regions, size)


@pytest.mark.parametrize(("size", "beds"), [((16, 12), NEAR), ((640, 512), BEDS)])
def test_by_python(tmp_path, monkeypatch, size, beds):
    monkeypatch.setattr(simulated_scene, "BEDS", beds)
    dunes = campaign(tmp_path / "c", *size)
    for suggestion in suggest_regions(dunes):
        region = suggestion.region
        dunes.add_region(region.name, points=region.points_px, kind=region.kind.name.lower())
    with fieldkit.record(dunes, duration="10m") as session:
        slopes = [{"region": slope.region, "tilt_deg": slope.tilt_deg} for slope in recorded_slopes(session)]
    assert_true_slopes(slopes, dunes.regions, size, beds)


def test_beds_that_are_too_small_for_a_camera_are_said_to_be(tmp_path):
    with pytest.raises(NoAnswerError) as raised:
        suggest_regions(campaign(tmp_path / "c", 16, 12))
    assert "5 x 5" in str(raised.value)
