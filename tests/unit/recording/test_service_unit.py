"""The unit's text, judged by systemd's own tools."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.recording.service import NAME, Unit, campaign_of
from tests.harness.next_steps import at

ODD = 'three "beds" 100 % $HOME \\ ü'
SYSTEM_EXPOSURE, USER_EXPOSURE = 20, 70  # tenths; 1.8 and 6.6 were measured with systemd 252
needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed (apt install systemd)"
)


def system_unit(campaign: Path) -> Unit:
    return Unit(campaign, "daemon", ("video", "dialout", "plugdev"), record=True)


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / ODD
    folder.mkdir()
    return folder


@pytest.fixture
def analyze(tmp_path):
    """Runs systemd-analyze on a unit, as the manager of the user or of the system would read it."""

    def run(unit: Unit, *words: str) -> subprocess.CompletedProcess[str]:
        path = tmp_path / NAME
        path.write_text(unit.text(), encoding="utf-8")
        (tmp_path / "run").mkdir(exist_ok=True)
        manager = ["--user"] if unit.owner is None else ["--system"]
        command = ["systemd-analyze", *manager, *words, str(path)]
        environment = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path / "run"), "LC_ALL": "C.UTF-8"}
        return subprocess.run(command, capture_output=True, text=True, env=environment)

    return run


@needs_systemd
@pytest.mark.parametrize("kind", ["user", "system"])
def test_systemd_accepts_the_unit(analyze, campaign, kind):
    done = analyze(system_unit(campaign) if kind == "system" else Unit(campaign, record=True), "verify")
    assert (done.returncode, done.stderr) == (0, "")


@needs_systemd
@pytest.mark.parametrize(("kind", "exposure"), [("system", SYSTEM_EXPOSURE), ("user", USER_EXPOSURE)])
def test_the_exposure_stays_low(analyze, campaign, kind, exposure):
    unit = system_unit(campaign) if kind == "system" else Unit(campaign)
    done = analyze(unit, "security", "--offline=true", "--no-pager", f"--threshold={exposure}")
    assert done.returncode == 0, done.stdout[-200:]


def test_the_page_comes_after_recovery_and_records_if_wanted(campaign):
    text = Unit(campaign, record=True, page=("--address", "192.168.4.1")).text()
    assert re.search(r"^ExecStartPre=-\S+ -P -m fieldkit recover$", text, re.MULTILINE)
    assert re.search(
        r"^ExecStart=\S+ -P -m fieldkit page --record --address 192.168.4.1$", text, re.MULTILINE
    )
    assert "--record" not in Unit(campaign).text()


def test_a_user_service_asks_for_nothing_that_needs_privilege(campaign):
    """systemd.exec(5): these are only for system services, or need a user namespace."""
    text = Unit(campaign).text()
    for setting in ("User=", "SupplementaryGroups=", "Protect", "Private", "Capability", "DeviceAllow="):
        assert setting not in text
    assert "WantedBy=default.target" in text


def test_the_campaign_is_read_back_from_the_unit(campaign):
    assert campaign_of(system_unit(campaign).text()) == campaign


@pytest.mark.parametrize("folder", ["/tmp/beds", "/var/tmp/a b: 100 %"])
def test_a_system_service_sees_its_campaign_in_a_temporary_folder(folder):
    """systemd.exec(5): PrivateTmp= hides what others have there, BindPaths= shows a folder of the host."""
    text = Unit(Path(folder), "pi", python="/tmp/venv/bin/python").text()
    assert "\nPrivateTmp=yes\n" in text
    quoted = folder if folder == "/tmp/beds" else '"/var/tmp/a b: 100 %%"'
    assert f"\nBindPaths={quoted}\nBindReadOnlyPaths=/tmp/venv\n" in text
    assert "Bind" not in Unit(Path("/home/pi/tmp/beds"), "pi", python="/usr/bin/python3").text()
    assert "Bind" not in Unit(Path(folder)).text()


@needs_systemd
def test_systemd_accepts_a_temporary_folder(analyze, tmp_path):
    folder = tmp_path / "a: b"
    folder.mkdir()
    done = analyze(Unit(folder, "daemon"), "verify")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_folder_that_no_unit_can_name(tmp_path):
    with pytest.raises(ConfigError, check=at(repr(str(tmp_path / "two\nlines")))):
        Unit(tmp_path / "two\nlines").text()
