"""`fieldkit.open_campaign`: sessions, estimates, pandas and xarray."""

import numpy as np
import pandas as pd
import pytest

import fieldkit
from fieldkit.model.errors import ConfigError
from fieldkit.results.session import open_session
from fieldkit.results.sources import config_for
from tests.harness.command_line import document, succeed
from tests.harness.replayed_minutes import replayed_minutes


@pytest.fixture
def campaign(folder):
    return fieldkit.open_campaign(folder)


def test_settings_replace_values_of_the_file_and_stay_when_a_region_is_added(folder, tmp_path):
    (tmp_path / "fieldkit.toml").write_text((folder / "fieldkit.toml").read_text("utf-8"), "utf-8")
    campaign = fieldkit.open_campaign(tmp_path, {"record.every_s": 30.0, "albedo": 0.3})
    before = campaign.config.tables.record.every_s, campaign.config.surface_parameters().albedo
    campaign.add_region("mud", rect=(2, 2, 12, 12))
    after = campaign.config.tables.record.every_s, campaign.config.surface_parameters().albedo
    assert after == before == (30, 0.3)
    assert fieldkit.open_campaign(tmp_path).config.tables.record.every_s != 30.0


def test_a_region_is_added_by_numbers_and_arrays_of_numpy(folder, tmp_path):
    (tmp_path / "fieldkit.toml").write_text((folder / "fieldkit.toml").read_text("utf-8"), "utf-8")
    campaign = fieldkit.open_campaign(tmp_path)
    corners = np.array([[2, 2], [14, 2], [14, 14.5], [2, 14]])
    campaign.add_region("mud", points=corners, tilt_deg=np.float32(7), azimuth_deg=np.int64(90))
    (mud,) = (region for region in fieldkit.open_campaign(tmp_path).config.regions if region.name == "mud")
    assert (mud.points_px, mud.tilt_deg, mud.azimuth_deg) == (tuple(map(tuple, corners.tolist())), 7.0, 90.0)


def test_other_parameters_give_other_slopes_and_the_cache_gives_them_again(campaign, cache_folder):
    session = campaign.sessions[0]
    first = session.estimate(albedo=0.25, model="paper")
    usual = session.estimate(model="paper")
    assert not np.array_equal(first.rows["tilt_deg"], usual.rows["tilt_deg"], equal_nan=True)
    entries = len(list(cache_folder.rglob("*.arrays")))
    again = session.estimate({"surface.albedo": 0.25, "estimator.model": "paper"})
    assert again.rows.tobytes() == first.rows.tobytes()
    assert again.texts == first.texts
    assert len(list(cache_folder.rglob("*.arrays"))) == entries


def test_a_frame_has_a_row_for_each_minute_and_bed(campaign):
    estimates = campaign.sessions[0].estimate()
    frame = estimates.to_frame()
    assert len(frame) == len(estimates) == 3 * estimates.minutes
    assert str(frame.index.tz) == "UTC"
    ok = frame[frame.state == "ok"]
    assert set(ok.region) <= {"b05", "b15", "b25"}
    assert (ok.true_tilt_deg == ok.region.str[1:].astype(float)).all()
    assert ok.temperature_k.dropna().between(250, 350).all()


def test_a_dataset_has_time_and_region(campaign):
    estimates = campaign.sessions[0].estimate()
    dataset = estimates.to_xarray()
    assert dict(dataset.sizes) == {"time": estimates.minutes, "region": 3}
    last = list(estimates)[-1]
    assert float(dataset.tilt_deg[-1].sel(region=last.region)) == pytest.approx(last.tilt_deg, nan_ok=True)


def test_ambiguous_names_and_impossible_values_are_refused(campaign):
    with pytest.raises(ConfigError, match=r"irradiance\.diffuse_fraction"):
        campaign.sessions[0].estimate(diffuse_fraction=0.2)
    with pytest.raises(ConfigError, match=r"albedo=1\.5"):
        campaign.sessions[0].estimate(albedo=1.5)


def test_a_pyrheliometers_log_beside_a_session_gives_its_light_and_says_so(folder, sessions, tmp_path):
    with open_session(sessions[0]) as session:
        begin = session.start_ns // 10**9
    log = tmp_path / "sun.csv"
    log.write_text("time,DNI [W/m2]\n" + "".join(f"{begin + 30 * row},900\n" for row in range(22)))
    made = succeed(
        "import", log, "--as", "sun", "--into", sessions[0], "-o", tmp_path / "both.h5", "-C", folder
    )
    assert "sun (dni)" in made.output
    assert 'irradiance.stream = "lux"' in made.output
    with open_session(tmp_path / "both.h5") as both:
        for stream, label in (("", "pyrheliometer"), ("lux", "eq10")):
            config = config_for(both, [f"irradiance.stream={stream!r}", "estimator.model='paper'"])
            minutes = replayed_minutes(both, config)
            assert minutes[5].irradiance_model.startswith(label)
            assert (minutes[5].dni_w_m2 == 900.0) == (not stream)
    checks = {(finding.what, finding.level) for finding in fieldkit.check(tmp_path / "both.h5").findings}
    assert ("slopes", "ok") in checks


def test_a_sweep_from_python_is_that_of_the_command_line(campaign, folder, tmp_path):
    found = campaign.sweep({"albedo": np.array([0.20, 0.25]), "estimator.model": ["paper", "full"]})
    frame = found.to_frame()
    grid = ("--set", "surface.albedo=0.2,0.25", "--set", "estimator.model=paper,full")
    told = document("sweep", folder / "recordings", *grid, "-j", 1, "-o", tmp_path / "x")["ranking"]
    written = pd.read_csv(tmp_path / "x.csv", comment="#")
    assert len(frame) == len(written) == 2 * 4 * 3
    assert frame["median_abs_error_deg"].tolist() == pytest.approx(
        written["median_abs_error_deg"].tolist(), nan_ok=True
    )
    best, told_best = (dict(ranking) for ranking in (found.best, told["best"]))
    assert float(best.pop("surface.albedo")) == float(told_best.pop("surface.albedo"))
    assert best == told_best
    assert found.ranking.cross_validated_deg == pytest.approx(told["left_out_deg"])
    assert found.failures == {}


def test_a_sweep_from_python_names_what_it_could_not_read_and_goes_on(campaign, tmp_path):
    broken = tmp_path / "broken.h5"
    broken.write_bytes(b"no session")
    sessions = [campaign.sessions[0], broken]
    found = campaign.sweep({"albedo": [0.2]}, sessions=sessions)
    assert list(found.failures) == [broken]
    assert set(found.columns["session"]) == {campaign.sessions[0].name}


def test_a_sweep_over_nothing_or_over_what_no_estimate_has_is_refused(campaign):
    for parameters in ({"albedo": []}, {"albedo": "0.2"}, {"record.every_s": [1.0, 2.0]}):
        with pytest.raises(ConfigError):
            campaign.sweep(parameters)
