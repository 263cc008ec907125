"""Two views of a board belong to one camera."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fieldkit.calibrate.uniformity import BLOCK_NS, _one_camera, target_view
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import RegionKind
from tests.harness.next_steps import at

CAMERA = StreamInfo(
    "camera", "brightness_temperature", "K", (120, 160),
    model="Lepton 3.5", serial_number="12", settings={"gain": "high"},
)  # fmt: skip


def session(name: str, camera: StreamInfo) -> SimpleNamespace:
    return SimpleNamespace(path=Path(name), streams={"camera": camera})


def test_the_camera_of_both_views_is_that_of_the_record():
    found = _one_camera([session("a.h5", CAMERA), session("b.h5", CAMERA)])
    assert (found.model, found.serial_number, found.range) == ("Lepton 3.5", "12", "high")


@pytest.mark.parametrize("other", [{"serial_number": "13"}, {"settings": {"gain": "low"}}])
def test_views_of_two_cameras_or_ranges_are_not_averaged(other):
    with pytest.raises(ConfigError, match=r"Lepton 3\.5 12 high", check=at("b.h5")):
        _one_camera([session("a.h5", CAMERA), session("b.h5", replace(CAMERA, **other))])


def test_three_blocks_of_a_board_state_an_offset_that_holds_the_truth_19_times_of_20(monkeypatch):
    """Student's t, JCGM 100 G.3: without its factor k = 2 held it 4 times of 5."""
    kinds = {"flat": RegionKind.REFERENCE, "b15": None}
    regions = [SimpleNamespace(name=name, kind=kind) for name, kind in kinds.items()]
    random, held = np.random.default_rng(2), []
    for _ in range(500):
        series = SimpleNamespace(
            regions=("flat", "b15"), time_ns=np.arange(3) * BLOCK_NS, flags=np.zeros(3, np.uint32),
            mean_k=np.column_stack([np.full(3, 290.0), 290.3 + 0.05 * random.standard_normal(3)]),
        )  # fmt: skip
        monkeypatch.setitem(target_view.__globals__, "region_series", lambda session, series=series: series)
        view = target_view(SimpleNamespace(regions=regions, path=Path("board.h5")))
        held.append(abs(view.offset_k["b15"] - 0.3) < 2.0 * view.offset_sd_k["b15"])
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)
