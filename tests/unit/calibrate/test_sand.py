"""What a session taught becomes the prior of another one."""

from dataclasses import replace

import pytest

import fieldkit
from fieldkit.config import load_config
from fieldkit.estimation.scale import with_known
from fieldkit.model.errors import CalibrationError, ConfigError
from fieldkit.model.samples import Frame, Quality, Sample
from fieldkit.model.site import Region, RegionKind
from fieldkit.results.minutes import Outcome, Run, run_of
from fieldkit.results.sources import source_of
from fieldkit.results.sweep import prior_of_others, read_grid, sweep
from tests.harness.calibration_days import rewritten

CORNERS = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))
FLAT = Region("flat", RegionKind.REFERENCE, CORNERS)
B05, B15 = (Region(f"b{tilt:02d}", RegionKind.TARGET, CORNERS, tilt, 180.0) for tilt in (5, 15))
UNKNOWN = Region("slope", RegionKind.TARGET, CORNERS)
LEARNED = {"estimator.model": "learned"}


def test_known_slopes_are_references_and_may_be_steeper():
    found = with_known((FLAT, B05, B15, UNKNOWN), {"b05", "b15"}, steeper_deg=0.5)
    assert [region.kind for region in found.latest] == [RegionKind.REFERENCE] * 3 + [RegionKind.TARGET]
    assert [region.tilt_deg for region in found.latest[1:3]] == [5.5, 15.5]


def test_the_flattest_stays_a_target_where_no_other_is_left():
    found = with_known((FLAT, B15, B05), {"b05", "b15"})
    assert {region.name for region in found.latest if region.kind is RegionKind.TARGET} == {"b05"}


@pytest.fixture(scope="module")
def sand(folder):
    return fieldkit.calibrate.surface(
        next((folder / "recordings").glob("*s1.h5")), beds=["b15"], name="this-sand", settings=LEARNED
    )


def test_a_session_teaches_gain_conductivity_and_depth(sand):
    record = sand.record
    assert (record.kind, record.details["model"]) == ("surface", "learned")
    assert set(record.values) == set(record.uncertainties) == {"conductivity_w_m_k", "depth_m"}
    assert record.standard_uncertainty == pytest.approx(record.details["prior_sds"]["prior.gain_sd"])
    assert [line.kind for line in record.budget] == ["A", "B", "B"]
    assert record.budget[2].name == "inclinometer"
    assert record.sources[0].session.endswith("s1.h5")
    assert 9 <= record.details["minutes"] <= 12


def test_the_next_session_takes_it_as_its_prior(sand, folder, tmp_path):
    sand.save(tmp_path / "calibration")
    text = (folder / "fieldkit.toml").read_text(encoding="utf-8")
    (tmp_path / "fieldkit.toml").write_text(text, encoding="utf-8")
    used = [one.replace(" = ", "=").replace('"', "") for one in sand.used_by.split(", ")]
    config = load_config(tmp_path / "fieldkit.toml", settings=["estimator.model=learned", *used])
    settings, sds = config.estimator_settings(), sand.record.details["prior_sds"]
    assert settings.scale == pytest.approx(sand.record.value)
    assert settings.prior.depth_log_sd == pytest.approx(sds["prior.depth_log_sd"])
    assert settings.prior.inertia_log_sd == pytest.approx(sds["prior.inertia_log_sd"])
    assert settings.slab.depth_m == pytest.approx(sand.record.values["depth_m"])


def test_a_session_without_a_usable_frame_teaches_nothing(sessions, tmp_path):
    def flagged(sample: Sample) -> Sample:
        return sample._replace(quality=Quality.SHUTTER) if isinstance(sample, Frame) else sample

    shuttered = rewritten(sessions[0], tmp_path / "shuttered.h5", flagged)
    with pytest.raises(CalibrationError, match="reference"):
        fieldkit.calibrate.surface(shuttered, settings=LEARNED)


@pytest.fixture
def runs(sessions):
    return [run_of(source_of(path), ["estimator.model=learned"]) for path in sessions]


def test_each_session_gets_what_the_others_taught(runs):
    seen: list[Run] = []

    def estimate(asked: list[Run]) -> list[Outcome]:
        seen.extend(asked)
        return []

    found = {run.source.path: prior for run, prior in prior_of_others(runs, estimate)}
    assert set(found) == {run.source.path for run in runs}
    kinds = {region.name: region.kind for region in seen[0].source.regions.latest}
    assert kinds["b15"] is RegionKind.REFERENCE
    prior = dict(one.split("=") for one in found[runs[0].source.path])
    assert float(prior["estimator.scale"]) == 1.0  # nobody taught anything


def test_a_single_session_and_another_model_have_no_others(runs):
    with pytest.raises(ConfigError, match="two sessions"):
        list(prior_of_others(runs[:1], lambda asked: []))
    paper = [replace(run, settings=replace(run.settings, model="paper")) for run in runs]
    with pytest.raises(ConfigError, match="learned model"):
        list(prior_of_others(paper, lambda asked: []))


def test_the_prior_of_a_sweep_is_configured_or_others():
    with pytest.raises(ConfigError, match="prior=mine"):
        read_grid(["prior=mine"])


def test_a_sweep_ranks_the_prior_of_others(sessions):
    found = sweep(sessions, {"estimator.model": ["learned"], "prior": ["configured", "others"]})
    assert found.ranking is not None
    (effect,) = found.ranking.effects
    assert (effect.key, effect.values) == ("prior", ("configured", "others"))
    assert effect.error_deg[0] != effect.error_deg[1]
