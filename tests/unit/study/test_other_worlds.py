"""How well slopes can be known on Mars and on the Moon."""

import numpy as np
import pytest
from click.testing import CliRunner

from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.physics.sun import solar_time_h
from fieldkit.study.other_worlds import SITES, next_solar_time, world_study


@pytest.mark.parametrize("body", ["mars", "moon"])
@pytest.mark.parametrize("hour", [9.0, 15.0])
def test_the_next_hour_of_solar_time_is_found_to_the_minute(body, hour):
    found = next_solar_time(SITES[body], "2024-06-01", hour)
    assert solar_time_h(found, SITES[body]) == pytest.approx(hour, abs=0.02)
    assert found >= np.datetime64("2024-06-01", "ns").astype(np.int64)


def test_twenty_minutes_on_the_moon_are_worthless_and_a_day_is_not():
    study = world_study(SITES["moon"], "2024-06-01", noises_k=(0.1,), slopes=40)
    short = [window for window in study.windows if window.minutes == 20]
    assert {window.verdict for window in short} == {"worthless"}
    # the sun moves 30 times more slowly than on the Earth: so much less is known in the same time
    assert min(window.normal_p90_deg for window in short) > 13.5
    assert {window.verdict for window in study.windows if window.minutes == 24 * 60} == {"good"}
    assert "worthless" in study.summary[0]


def test_on_mars_the_paper_would_have_worked():
    study = world_study(SITES["mars"], "2024-06-01", noises_k=(0.05,), slopes=60)
    assert {window.verdict for window in study.windows} == {"good"}
    storm = world_study(SITES["mars"], "2024-06-01", noises_k=(0.05,), slopes=40, dust=4.0)
    assert storm.windows[0].normal_p90_deg > 10.0 * study.windows[0].normal_p90_deg


def test_no_model_no_study():
    with pytest.raises(ConfigError, match="venus"):
        world_study(Site(0.0, 0.0, body="venus"), "2024-06-01")


def test_the_command_writes_table_and_figure_and_refuses_what_the_earth_has(tmp_path):
    from fieldkit.cli import main

    run = CliRunner().invoke(
        main, ["study", "--body", "moon", "--noise", "0.1", "--slopes", "20", "--out", str(tmp_path)]
    )
    assert run.exit_code == 0, run.output
    assert "worthless" in run.output
    assert (tmp_path / "world.svg").read_text().startswith("<?xml")
    assert (tmp_path / "world.csv").exists()
    refused = CliRunner().invoke(main, ["study", "--body", "mars", "--turbidity", "3"])
    assert refused.exit_code == 2
    assert "belongs to the Earth" in refused.output
