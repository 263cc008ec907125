import math
from hashlib import sha256

import h5py
import pytest

from fieldkit.config import load_config
from fieldkit.model.errors import ConfigError, RefusedError
from fieldkit.model.next_step import Argument
from fieldkit.model.site import RegionKind
from fieldkit.recording.campaign import init_campaign
from fieldkit.recording.record import record
from fieldkit.recording.simulate import simulate
from fieldkit.recording.simulated_scene import scene_of
from fieldkit.simulation.drawn_field import drawn_field
from tests.harness.next_steps import at


def test_a_session_is_simulated_with_the_beds_that_were_asked_for(tmp_path):
    minutes = []
    with simulate(
        tmp_path / "c", beds={"gentle": (10, 180), "west": (20, 270)}, duration="3m", on_minute=minutes.append
    ) as session:
        slopes = {region.name: (region.tilt_deg, region.azimuth_deg) for region in session.regions}
        assert session.state == "sealed"
        assert session.header.command_line == ""  # of a notebook it would name the kernel
    assert slopes == {"flat": (0.0, 0.0), "gentle": (10.0, 180.0), "west": (20.0, 270.0)}
    assert [len(minute.estimates) for minute in minutes] == [2] * len(minutes)
    assert len(minutes) == 4  # three, and the one begun


def test_a_simulated_session_holds_the_bytes_it_always_held(tmp_path):
    """By stamps, counters, flags and what the meters sent; pixels may differ by a count on another processor.

    The digest is of a session recorded while a thread of the clock's own still moved time. Only a scene,
    an instrument or a protocol that is meant to be another one changes it; a faster clock or writer does not.
    """
    stamps = ("time", "mono_ns", "device_time", "seq", "device_seq", "flags")
    columns = {"camera": stamps, "lux": (*stamps, "raw"), "thermometer": (*stamps, "raw")}
    found = sha256()
    path = simulate(tmp_path / "c", day="alamosa-2016-01-01", duration="3m", seed=7).path
    with h5py.File(path) as file:
        for stream, names in columns.items():
            for name in names:
                column = file[stream][name][:]
                # as wide as flags were then
                found.update((column.astype("<u2") if name == "flags" else column).tobytes())
    assert found.hexdigest() == "bdbcaa5e6462f8bd7bbd3ecb1fe49d6cb12307b1c5d14100a29e4631c1e4f2ce"


def test_more_beds_than_fit_the_frame_or_a_second_campaign_in_a_folder_are_refused(tmp_path):
    with pytest.raises(ConfigError, check=at(Argument("beds"))):
        simulate(tmp_path / "c", beds=dict.fromkeys("abcd", (5, 180)))
    init_campaign(tmp_path / "d", simulated=True)
    with pytest.raises(RefusedError):
        simulate(tmp_path / "d")


def test_a_campaign_made_in_python_takes_regions_and_is_recorded(tmp_path):
    campaign = init_campaign(tmp_path / "c", simulated=True)
    campaign.add_region("corner", rect=(1, 1, 12, 12), tilt_deg=7, azimuth_deg=90)
    corner = campaign.config.regions[-1]
    assert (corner.name, corner.kind, corner.tilt_deg) == ("corner", RegionKind.TARGET, 7.0)
    assert corner.points_px == ((1, 1), (12, 1), (12, 12), (1, 12))
    campaign.add_region("tilt-alone", rect=(20, 1, 12, 12), tilt_deg=15)  # the azimuth is not known
    assert math.isnan(campaign.regions[-1].azimuth_deg)
    with pytest.raises(ConfigError):
        init_campaign(tmp_path / "d", (135.0, 0.0))
    assert not (tmp_path / "d").exists()
    with pytest.raises(ConfigError, match="soon"):
        record(campaign, duration="soon")
    with pytest.raises(ConfigError, check=at("nothing", Argument("points"), Argument("rect"))):
        campaign.add_region("nothing")


def test_the_seed_draws_the_field_where_that_is_configured(tmp_path):
    campaign = init_campaign(tmp_path / "c", simulated=True)
    usual = scene_of(campaign.config, 600.0)
    drawn = scene_of(load_config(tmp_path / "c" / "fieldkit.toml", settings=["simulation.drawn=true"]), 600.0)
    truth = drawn_field(usual.seed)
    assert drawn.exchange == truth.exchange
    assert drawn.light_factor == truth.light_factor
    assert drawn.facets == tuple(truth.bed(facet) for facet in usual.facets)
