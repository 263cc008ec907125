"""A stranger's way from the installed package to a slope: few commands, nothing edited, nothing asked."""

import json
from glob import glob

from click.testing import Result

from fieldkit.simulation.scene import BEDS
from tests.harness.command_line import fieldkit

COMMANDS = (
    ("init", "--simulated", "sand"),
    ("doctor", "-C", "sand"),
    ("record", "-C", "sand", "--for", "12m", "--set", "simulation.speed=max"),
    ("check", "-C", "sand"),
    ("estimate", "sand/recordings/*.h5", "--json"),
    ("report", "-C", "sand"),
)


def test_six_commands_lead_from_nothing_to_a_slope_and_its_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(COMMANDS) <= 6
    done: dict[str, Result] = {}
    for words in COMMANDS:
        typed = [path for word in words for path in (sorted(glob(word)) or [word])]  # as a shell does
        done[words[0]] = fieldkit(*typed, "--no-input")
        may_lack_instruments = words[0] == "doctor"  # of this computer: the simulated ones need none
        assert done[words[0]].exit_code == 0 or may_lack_instruments, done[words[0]].output
    tilts = {bed.name: bed.tilt_deg for bed in BEDS}
    found = {one["region"]: one for one in json.loads(done["estimate"].stdout)["slopes"]}
    assert {"b05", "b15", "b25"} <= found.keys()
    for name, slope in found.items():
        low, high = slope["tilt_region_deg"]
        assert low <= tilts[name] <= high, slope  # the truth of the simulated field
    assert list((tmp_path / "sand/reports").glob("*.html"))
