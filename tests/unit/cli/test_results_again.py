"""Results of ``fieldkit estimate -o`` and what ``fieldkit report`` makes of them again."""

import json

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.results import result_files
from tests.harness.command_line import fieldkit, succeed


@pytest.fixture(scope="module")
def session(recorded, tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("again"))


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def test_results_of_the_campaigns_configuration_are_reported_with_it(session, tmp_path):
    base, settings = tmp_path / "r", ("surface.albedo=0.35",)
    succeed("estimate", session, "-j", 1, "-o", base)
    assert result_files.recall((base,), settings) == ((session,), settings, False)
    succeed("estimate", session, "-j", 1, "-o", base, "--campaign")
    assert result_files.recall((base,), settings) == ((session,), settings, True)
    campaign = session.parent.parent / "fieldkit.toml"
    before = campaign.read_text("utf-8")
    campaign.write_text("nonsense")
    try:
        found = fieldkit("report", base, "-o", tmp_path / "report.html")
    finally:
        campaign.write_text(before)
    assert found.exit_code == 3
    assert "fieldkit.toml" in found.stderr


def test_results_may_be_named_by_any_of_their_files(session, tmp_path):
    succeed("estimate", session, "-j", 1, "-o", tmp_path / "r")
    for ending in result_files.ENDINGS:
        assert result_files.recall((tmp_path / f"r{ending}",), ())[0] == (session,)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "cannot be read"),
        ("[1]", "not what an estimate wrote"),
        ('{"weather": "fine"}', "not what an estimate wrote"),
        (json.dumps({"sessions": [], "parameters": {}}), "many sets of parameters"),
    ],
)
def test_what_is_no_result_is_called_so(tmp_path, text, said):
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(ConfigError, match=said):
        result_files.recall((tmp_path / "bad",), ())


def test_the_folder_one_is_in_may_be_reported(session, monkeypatch):
    monkeypatch.chdir(session.parent)
    succeed("report", ".")


@pytest.mark.parametrize("nameless", [".", ".."])
@pytest.mark.parametrize("verb", [("estimate",), ("map",), ("sweep", "--set", "surface.albedo=0.1,0.2")])
def test_a_folder_is_no_name_for_results(session, tmp_path, monkeypatch, verb, nameless):
    monkeypatch.chdir(tmp_path)
    found = fieldkit(*verb, session, "-o", nameless)
    assert found.exit_code == 2, found.output
    assert f"-o {nameless} " in found.stderr
    assert not list(tmp_path.glob("**/*.csv"))
