"""Regions of a second camera that shows everything 0.4 K too warm, from the recording to the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fieldkit
from fieldkit.config import ConfigMistakesError, load_config
from fieldkit.config.template import SIMULATED
from fieldkit.model.site import RegionKind
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.regions import first_frames_k
from fieldkit.results.session import Session
from tests.harness.once import made_once

TILTS_DEG = {"b05": 5.0, "b15": 15.0, "b25": 25.0}
SECOND = '[device.second]\ndriver = "purethermal"\nport = "simulated"\n\n[[region]]'


def campaign_file(folder: Path) -> Path:
    simulation = {**SIMULATED["simulation"], "speed": "max", "camera_offset_k": {"second": 0.4}}
    file = create_campaign(folder, {**SIMULATED, "simulation": simulation}).config.path
    text = file.read_text().replace("[[region]]", SECOND, 1)
    for name in ("b15", "b25"):
        text = text.replace(f'name = "{name}"', f'name = "{name}"\ncamera = "second"')
    file.write_text(text)
    return file


def record(folder: Path) -> None:
    fieldkit.record(campaign_file(folder).parent, duration="15m")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    folder = made_once(tmp_path_factory, "second-camera", record)
    return fieldkit.open_session(next((folder / "recordings").glob("*.h5")))


def test_regions_of_both_cameras_are_estimated_live_and_again_with_the_same_result(session):
    live = {estimate.region: estimate for estimate in session.estimates()}  # the last of each
    again = session.estimate()
    for name, tilt_deg in TILTS_DEG.items():
        assert again[name].tilt_deg == pytest.approx(live[name].tilt_deg, abs=1e-9)
        assert again[name].tilt_low_deg == pytest.approx(live[name].tilt_low_deg, abs=1e-9)
        assert live[name].tilt_low_deg < tilt_deg < live[name].tilt_high_deg


@pytest.mark.parametrize("model", ["learned", "full", "paper"])
def test_an_uncertain_offset_between_cameras_widens_a_slope_unless_its_own_has_a_reference(session, model):
    beside_own = [
        replace(region, kind=RegionKind.REFERENCE, camera="second") if region.name == "b05" else region
        for region in session.regions
    ]
    alone, beside = (session.estimate(model=model, regions=regions) for regions in (None, beside_own))
    assert "reference" not in alone["b05"].reason
    for name in ("b15", "b25"):
        assert "reference" in alone[name].reason
        assert "reference" not in beside[name].reason
        assert beside[name].tilt_low_deg > alone[name].tilt_low_deg
        assert beside[name].tilt_low_deg < TILTS_DEG[name] < beside[name].tilt_high_deg


def test_series_map_and_report_show_a_region_in_its_own_cameras_frames(session):
    names = {stream: session[stream].region_series().regions for stream in ("camera", "second")}
    assert names == {"camera": ("flat", "b05"), "second": ("b15", "b25")}
    assert [region.name for region in session.slope_map(window="all").regions] == ["flat", "b05"]
    assert session.report().path.exists()
    first, second = (first_frames_k(session.path, stream).mean(axis=0) for stream in ("camera", "second"))
    assert np.median(second - first) == pytest.approx(0.4, abs=0.05)


def test_a_regions_camera_must_be_a_device_beside_the_first(tmp_path):
    file = campaign_file(tmp_path)
    file.write_text(file.read_text().replace('camera = "second"', 'camera = "third"', 1))
    with pytest.raises(ConfigMistakesError) as error:
        load_config(file)
    (mistake,) = error.value.mistakes
    assert "region[2].camera" in mistake
