"""Two estimates of the same sessions: which regions moved, by how much, and what differed."""

import math

import pytest

import fieldkit
from fieldkit.model.errors import ConfigError
from tests.harness.command_line import document, succeed

FULL = {"estimator.model": "full"}


def test_moves_are_those_of_the_final_slopes_with_what_differed(sessions):
    ours = fieldkit.estimate(sessions, FULL, albedo=0.25)
    comparison = fieldkit.compare(ours, fieldkit.estimate(sessions, FULL))
    assert dict(comparison.differences) == {"surface.albedo": ("", "0.25")}
    assert len(comparison.moves) == 6
    other = fieldkit.estimate(sessions[0], FULL)
    (move,) = (m for m in comparison.moves if (m.session, m.region) == (sessions[0].stem, "b15"))
    final = ours.estimates[sessions[0].stem]["b15"]
    assert (move.tilt_deg, move.other_tilt_deg) == (final.tilt_deg, other["b15"].tilt_deg)
    assert move.moved_deg == final.tilt_deg - other["b15"].tilt_deg != 0.0
    assert move.moved_half_widths == pytest.approx(move.moved_deg / final.tilt_half_width_deg)
    sizes = [abs(move.moved_half_widths) for move in comparison.moves]
    assert [size for size in sizes if math.isfinite(size)] == sorted(
        filter(math.isfinite, sizes), reverse=True
    )


def test_against_what_was_written_earlier(sessions, tmp_path):
    ours = fieldkit.estimate(sessions, FULL)
    ours.write(tmp_path / "base")
    same = fieldkit.compare(fieldkit.estimate(sessions, FULL), tmp_path / "base")
    assert dict(same.differences) == {}
    assert {move.moved_deg for move in same.moves if math.isfinite(move.moved_deg)} == {0.0}
    about = (tmp_path / "base.json").read_text().replace(ours.about["code_version"], "0.1.0+older")
    (tmp_path / "base.json").write_text(about)
    other = fieldkit.compare(ours, str(tmp_path / "base"))
    assert dict(other.differences) == {"code version": ("0.1.0+older", ours.about["code_version"])}
    assert list(other.to_frame()["region"]) == [move.region for move in other.moves]
    first = fieldkit.compare(fieldkit.estimate(sessions[:1], FULL), ours)  # the second is in one of them only
    assert dict(first.differences) == {}


def test_the_campaign_as_it_is_now_is_named(sessions):
    ours = fieldkit.estimate(sessions[:1], FULL)
    other = fieldkit.compare(ours, fieldkit.estimate(sessions[:1], FULL, present=True))
    assert dict(other.differences) == {"campaign": ("as it is now", "as recorded")}


def test_the_command_compares_with_settings_and_files(sessions, tmp_path):
    words = ("estimate", *sessions, "--set", "estimator.model=full", "-j", 1)
    found = document(*words, "--against", "estimator.model=full", "--against", "surface.albedo=0.3", "--json")
    assert found["differences"] == {"surface.albedo": ["0.3", ""]}
    assert {move["region"] for move in found["moves"]} == {"b05", "b15", "b25"}
    succeed(*words, "-o", tmp_path / "base")
    lines = succeed(*words, "--against", tmp_path / "base").stdout.splitlines()
    assert len(lines) == 1 + 6


def test_what_was_not_estimated_cannot_be_compared(sessions, tmp_path):
    first, second = (fieldkit.estimate([path], FULL) for path in sessions)
    for other in (second, tmp_path / "nothing"):
        with pytest.raises(ConfigError):
            fieldkit.compare(first, other)
