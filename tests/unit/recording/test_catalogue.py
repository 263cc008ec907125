"""The catalogue of sessions: chosen rows, one file beside the cache, as a table in Python."""

import shutil

import pytest

import fieldkit
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.recording import catalogue as catalogue_module
from fieldkit.recording.catalogue import COLUMNS, catalogue_of
from fieldkit.recording.recordings import sessions_in
from fieldkit.results.describe import settings_digest
from tests.harness.command_line import document, succeed


def test_a_row_for_each_session_and_region_has_the_slopes_as_recorded(folder, sessions):
    table = fieldkit.catalogue(folder)
    assert (len(table), list(table.columns())) == (2, list(COLUMNS))
    for path in sessions:
        with fieldkit.open_session(path) as session:
            rows = {row["region"]: row for row in table.rows() if row["session"] == path.name}
            final = {slope.region: slope for slope in session.estimates()}
            assert rows.keys() == final.keys()
            for region, slope in final.items():
                row = rows[region]
                assert (row["tilt_deg"], row["tilt_high_deg"]) == (slope.tilt_deg, slope.tilt_high_deg)
                assert (row["state"], row["fieldkit_version"]) == (
                    slope.state.name.lower(),
                    fieldkit.__version__,
                )
    assert {row["true_tilt_deg"] for row in table.rows()} == {5.0, 15.0, 25.0}
    assert len({row["settings"] for row in table.rows()}) == 1
    assert table.to_frame().shape == (6, len(COLUMNS))


@pytest.mark.parametrize(
    ("options", "regions"),
    [
        (("--where", "true_tilt > 10"), ["b15", "b25"] * 2),
        (("--where", "true_tilt > 10", "--since", "2016-01-01T12:00"), ["b15", "b25"] * 2),
        (("--where", "true_tilt > 10 and session_state != 'sealed'"), []),
        (("--since", "2016-01-02"), []),
        (("--since", "2016"), ["b05", "b15", "b25"] * 2),
    ],
)
def test_chosen_rows_as_json(folder, options, regions):
    listed = document("ls", "-C", folder, "--json", *options)["sessions"]
    assert [region["region"] for session in listed for region in session["regions"]] == regions


def test_slopes_that_meet_a_condition_stand_in_a_table(folder):
    lines = succeed("ls", "-C", folder, "--where", "true_tilt == 15").stdout.splitlines()
    assert [line.split()[1] for line in lines[1:]] == ["b15", "b15"]


@pytest.mark.parametrize("since", ["", "yesterday", "11.2026", "2026-11-03T1", "2026-1"])
def test_what_is_no_date_is_refused(folder, since):
    with pytest.raises(ConfigError) as error:
        fieldkit.catalogue(folder).since(since)
    assert error.value.place == Argument("since", since)


def test_known_sessions_are_not_opened_again_and_changed_ones_are(folder, tmp_path, monkeypatch):
    copy = shutil.copytree(folder / "recordings", tmp_path / "recordings")
    (copy / "torn.h5").write_bytes(b"torn")
    before = fieldkit.catalogue(tmp_path)
    opened, row = [], {**before.sessions[0], "problem": "not kept"}
    monkeypatch.setattr(catalogue_module, "_row", lambda path: opened.append(path.name) or row)
    fieldkit.catalogue(tmp_path)
    assert opened == ["torn.h5"]
    assert [row["region"] for row in before.where("session_state == 'unreadable'").rows()] == [""]
    first, _, _ = sorted(copy.glob("*.h5"))
    first.write_bytes(first.read_bytes())
    fieldkit.catalogue(tmp_path)
    assert sorted(opened) == sorted([first.name, "torn.h5", "torn.h5"])


def test_several_processes_find_the_same(folder, sessions, monkeypatch):
    monkeypatch.setattr(catalogue_module, "MANY", 2)
    recordings = folder / "recordings"
    parts = catalogue_module._describe(sessions, 2)
    assert parts == list(catalogue_of(recordings, sessions_in(recordings)).sessions)


def test_settings_of_an_estimate_alone_enter_their_digest():
    texts = ["", "[campaign]\ntitle = 'b'\n", "[surface]\nalbedo = 0.3\n", "[surface]\nalbedo = 0.30 # dry\n"]
    digests = list(map(settings_digest, texts))
    assert digests[0] == digests[1] != digests[2] == digests[3]
    assert settings_digest("not TOML") == ""
