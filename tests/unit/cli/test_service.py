"""``fieldkit service`` with programs in systemd's place that note what they are asked."""

import os
import pwd
from pathlib import Path

import pytest

from fieldkit.config import NoCampaignError
from fieldkit.model.errors import RefusedError
from fieldkit.recording import service
from fieldkit.recording.service import NAME, packaged_unit
from tests.harness.command_line import fieldkit, invoke, succeed
from tests.harness.next_steps import at

SYSTEMCTL = """#!/bin/sh
echo "$@" >> "$SERVICE_TEST/asked"
case "$*" in *"$SERVICE_TEST_FAILS"*) echo "Failed to connect to bus: No medium" >&2; exit 1;; esac
"""


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "some sand"
    succeed("init", "--simulated", folder)
    return folder


@pytest.fixture
def systemd(tmp_path, monkeypatch):
    """A computer with systemd, seen by a user who is not root; the folder of what systemd was asked."""
    folder = tmp_path / "systemd"
    folder.mkdir()
    for name, text in (("systemctl", SYSTEMCTL), ("loginctl", "#!/bin/sh\n")):
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.setenv("SERVICE_TEST", str(folder))
    monkeypatch.setenv("SERVICE_TEST_FAILS", "nothing")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    # the units of this computer are not for a test to change, and root may not own a service of a user
    monkeypatch.setattr(service, "SYSTEMD_RUNS", folder)
    monkeypatch.setattr(service, "SYSTEM_UNITS", tmp_path / "system")
    monkeypatch.setattr(service, "PACKAGED_UNITS", tmp_path / "packaged")
    monkeypatch.setattr(service, "LINGERING", tmp_path / "linger")
    monkeypatch.setattr(os, "geteuid", lambda: 12345)  # the tests may run as root
    return folder


@pytest.fixture
def root(systemd, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 0)  # the tests may not run as root


def run(*words: str | Path):
    return fieldkit("service", *words)


def unit(tmp_path: Path) -> Path:
    return tmp_path / "config" / "systemd" / "user" / NAME


def test_install_starts_it_now_and_at_boot(campaign, systemd, tmp_path):
    done = run("install", "-C", campaign, "--record", "--port", "8421")
    assert done.exit_code == 0, done.output
    text = unit(tmp_path).read_text()
    assert f"WorkingDirectory={campaign}" in text
    assert "fieldkit page --record --port 8421" in text
    asked = (systemd / "asked").read_text().splitlines()
    assert asked[:3] == ["--user daemon-reload", f"--user enable {NAME}", f"--user restart --no-block {NAME}"]
    assert "systemctl --user status" in done.stdout
    assert f"--link control -C '{campaign}' --port 8421" in done.stdout


def test_install_warns_of_what_a_person_must_do(campaign, systemd, monkeypatch):
    monkeypatch.setattr(service, "GROUPS", ("no-such-group",))  # those of this computer differ
    done = run("install", "-C", campaign)
    assert "sudo loginctl enable-linger 12345" in done.stderr
    # a campaign under /tmp is where all of pytest's are
    monkeypatch.setattr(service, "TEMPORARY", (str(campaign.parent),))
    again = run("install", "-C", campaign)
    assert f"warning: {campaign} " in again.stderr


def test_install_again_replaces_it_for_the_same_campaign_alone(campaign, systemd, tmp_path):
    assert run("install", "-C", campaign).exit_code == 0
    assert run("install", "-C", campaign, "--record").exit_code == 0
    other = tmp_path / "other"
    fieldkit("init", "--simulated", other)
    with pytest.raises(RefusedError, match=str(campaign)):
        invoke("service", "install", "-C", other)
    assert "--record" in unit(tmp_path).read_text()


def test_remove_stops_it_and_deletes_the_unit(campaign, systemd, tmp_path):
    run("install", "-C", campaign)
    done = run("remove")
    assert (done.exit_code, str(campaign) in done.stderr) == (0, True)
    assert not unit(tmp_path).exists()
    asked = (systemd / "asked").read_text().splitlines()
    assert asked[-2:] == [f"--user disable --now {NAME}", "--user daemon-reload"]
    assert run("remove").exit_code == 9


@pytest.mark.parametrize("verb", ["install", "remove"])
def test_without_rights(campaign, systemd, verb):
    with pytest.raises(RefusedError, match=r"(?s)root.*sudo"):
        invoke("service", verb, "--system", "-C", campaign)


def test_sudo_by_mistake(campaign, root, tmp_path):
    with pytest.raises(RefusedError, match="system"):
        invoke("service", "install", "-C", campaign)
    assert not unit(tmp_path).exists()


def test_a_system_service_runs_as_the_folders_owner(campaign, systemd, root, tmp_path):
    done = run("install", "-C", campaign, "--system")
    assert done.exit_code == 0, done.output
    assert f"\nUser={pwd.getpwuid(os.getuid()).pw_name}\n" in (tmp_path / "system" / NAME).read_text()
    assert (systemd / "asked").read_text().startswith("daemon-reload\n")
    assert run("remove").exit_code == 9
    assert run("remove", "--system").exit_code == 0


def test_without_a_session_of_the_user(campaign, systemd, monkeypatch):
    monkeypatch.setenv("SERVICE_TEST_FAILS", "daemon-reload")
    with pytest.raises(RefusedError, match=r"(?s)No medium.*sudo"):
        invoke("service", "install", "-C", campaign)


def test_without_systemd(campaign, monkeypatch, tmp_path):
    monkeypatch.setattr(service, "SYSTEMD_RUNS", tmp_path / "none")
    for verb in ("install", "remove"):
        with pytest.raises(RefusedError, match="systemd"):
            invoke("service", verb, "-C", campaign)
    assert run("install", "-C", campaign, "--print").stdout.startswith("# Written by fieldkit")


def test_without_a_campaign(systemd, tmp_path):
    with pytest.raises(NoCampaignError, check=at(tmp_path)):
        invoke("service", "install", "-C", tmp_path)


def test_remove_leaves_the_unit_of_a_package(root, tmp_path):
    packaged = tmp_path / "packaged"
    packaged.mkdir()
    (packaged / NAME).write_text(packaged_unit().text())
    with pytest.raises(RefusedError, match="systemctl disable --now"):
        invoke("service", "remove", "--system")
    assert (packaged / NAME).exists()
