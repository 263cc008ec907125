"""Settings of a region that are changed while a recording runs, which keeps them as it began."""

import threading
from functools import partial
from pathlib import Path

import pytest

from fieldkit.config import load_config
from fieldkit.config.edit import remove_region
from fieldkit.recording import redrawing
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.regions import add_region, edit_region
from fieldkit.recording.requests import SentRequest


@pytest.fixture
def file(tmp_path, monkeypatch):
    """The ``fieldkit.toml`` of a campaign that is being recorded."""
    monkeypatch.setattr(redrawing, "session_in_progress", lambda recordings: recordings / "x.h5")
    monkeypatch.setattr(
        redrawing, "send_to_recorder", lambda recordings, wanted: SentRequest(Path("x.h5"), "1")
    )
    return init_campaign(tmp_path / "field", simulated=True).config.path


def unused(file, change):
    return redrawing.change_regions(file, change)[1].unused


def test_an_offset_is_reported_as_not_used_by_the_recording(file):
    assert unused(file, partial(edit_region, name="b05", offset_k=0.5)) == ("b05: offset_k",)
    assert load_config(file).estimator_settings().offsets_k == {"b05": 0.5}
    assert unused(file, partial(edit_region, name="b05", offset_k=0.5)) == ()


def test_so_is_that_of_a_new_region_and_a_kind_of_surface_written_by_hand(file):
    corners = [(70, 90), (90, 90), (90, 110), (70, 110)]
    assert unused(file, partial(add_region, name="new", points=corners, offset_k=-0.2)) == ("new: offset_k",)

    def by_hand(draft):
        draft.text = draft.text.replace('name = "b25"', 'name = "b25"\nsurface_kind = "rock"')

    assert unused(file, by_hand) == ("b25: surface_kind",)


def test_what_a_recording_uses_is_not_named(file):
    change = partial(edit_region, name="b05", tilt_deg=6.0, azimuth_deg=170.0, emissivity=0.93, shrink_px=1.0)
    assert unused(file, change) == ()
    assert unused(file, partial(remove_region, name="b15")) == ()


def test_of_two_changes_at_once_the_last_request_has_the_regions_of_both(file, monkeypatch):
    """As of two browsers: the second change comes while the first is checked."""
    requested, second = [], []
    monkeypatch.setattr(
        redrawing,
        "send_to_recorder",
        lambda _, wanted: requested.append(names(wanted)) or SentRequest(file, "1"),
    )

    def names(wanted):
        return {region.name for region in wanted.regions}

    def check(*_, unless):
        if not second:
            second.append(threading.Thread(target=redrawing.change_regions, args=(file, addition("b", 90))))
            second[0].start()
            second[0].join(1.0)

    def addition(name, y):
        return partial(add_region, name=name, points=[(0, y), (20, y), (20, y + 9), (0, y + 9)])

    monkeypatch.setattr(redrawing, "check_configured", check)
    redrawing.change_regions(file, addition("a", 100))
    second[0].join()
    assert requested[-1] == {region.name for region in load_config(file).regions} > {"a", "b"}
