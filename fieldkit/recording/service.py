"""A campaign as a service of systemd: install it and remove it.

``systemctl status fieldkit`` shows how it is doing.

There is one service, `service_unit.NAME`, for the user or for the system: its campaign has the instruments.
"""

from __future__ import annotations

import grp
import logging
import os
import pwd
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from fieldkit.config import Config
from fieldkit.model.errors import RefusedError, StorageError
from fieldkit.model.next_step import Action, Argument, Step, Text
from fieldkit.recording.preflight import Notify
from fieldkit.recording.service_unit import GROUPS, NAME, Unit, campaign_of, is_temporary

SYSTEMD_RUNS = Path("/run/systemd/system")
"""Exists where systemd is the init process, see sd_booted(3)."""
SYSTEM_UNITS = Path("/etc/systemd/system")
PACKAGED_UNITS = Path("/usr/lib/systemd/system")
"""Folder of the unit of a distribution's package; one of the same name in `SYSTEM_UNITS` replaces it."""
LINGERING = Path("/var/lib/systemd/linger")
"""A file for each user whose services run without a login."""
PATIENCE_S = 300.0
"""Stopping the service seals its session first."""
log: logging.Logger = logging.getLogger(__name__)


def unit_of(config: Config, *, system: bool = False, record: bool = False, page: Sequence[str] = ()) -> Unit:
    """The unit that would be installed for a campaign; a system service runs as the folder's owner."""
    groups = [name for name in GROUPS if _is_group(name)] if system else []
    owner = _user_name(config.directory.stat().st_uid) if system else None
    return Unit(config.directory, owner, groups, record, page)


def install_service(unit: Unit, notify: Notify = log.warning) -> Path:
    """Write a unit, start it now and at every boot; its file. The same campaign's unit is replaced.

    `notify` receives what a person must still do. Raises `RefusedError` without systemd, without rights, or
    if the service is installed for another campaign, `StorageError` if the unit cannot be written.
    """
    text, is_system = unit.text(), unit.owner is not None
    _need_rights(is_system, "install")
    manager = _Manager(is_system)
    if (other := manager.campaign()) not in (None, unit.campaign):
        raise RefusedError(
            f"{NAME} is installed for {other}",
            fix=manager.removal + ", then install it",
        )
    _write(manager.unit, text)
    manager.systemctl("daemon-reload")
    manager.systemctl("enable", NAME)
    manager.systemctl("restart", "--no-block", NAME)
    for warning in _warnings(unit):
        notify(warning)
    return manager.unit


def remove_service(*, system: bool = False) -> Path:
    """Stop the service, which seals its recording, and delete its unit; the campaign it was for.

    Raises `RefusedError` if it is not installed, without systemd or without rights.
    """
    _need_rights(system, "remove")
    manager = _Manager(system)
    campaign = manager.campaign()
    if campaign is None:
        raise RefusedError(f"no {manager.words} is installed", fix=_installed_elsewhere(not system))
    manager.systemctl("disable", "--now", NAME)
    manager.unit.unlink()
    manager.systemctl("daemon-reload")
    return campaign


@dataclass(frozen=True, slots=True)
class _Manager:
    """The service manager of the system, or of the user."""

    is_system: bool

    @property
    def unit(self) -> Path:
        return (SYSTEM_UNITS if self.is_system else platformdirs.user_config_path("systemd") / "user") / NAME

    @property
    def words(self) -> str:
        return "system service" if self.is_system else "user service"

    @property
    def removal(self) -> Step:
        return Action.REMOVE_SERVICE(system=True) if self.is_system else Action.REMOVE_SERVICE()

    def campaign(self) -> Path | None:
        """The campaign of the unit that `install_service` wrote, None without one."""
        return campaign_of(self.unit.read_text(encoding="utf-8")) if self.unit.exists() else None

    def systemctl(self, *words: str) -> str:
        command = ["systemctl", *([] if self.is_system else ["--user"]), *words]
        try:
            process = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
        except subprocess.CalledProcessError as error:
            raise RefusedError(
                f"{' '.join(command)} failed: {error.stderr.strip()}", fix=self._fix()
            ) from None
        except subprocess.TimeoutExpired:
            raise RefusedError(f"{' '.join(command)} did not finish", fix=self._fix()) from None
        return process.stdout

    def _fix(self) -> str:
        if self.is_system:
            return f"journalctl --unit {NAME}"
        return "log in as this user, not by su or sudo; or install a system service"


def _need_systemd() -> None:
    if not SYSTEMD_RUNS.is_dir():
        raise RefusedError(
            "systemd does not run on this computer, so there is no service",
            fix="start the page, or a recording, by hand or by this computer's own init program",
        )


def _need_rights(system: bool, command: str) -> None:
    _need_systemd()
    is_root = os.geteuid() == 0
    if system and not is_root:
        raise RefusedError(
            f"only root may {command} a system service",
            fix="use sudo and the full path of the command, or omit " + Argument("system"),
        )
    if is_root and not system:
        raise RefusedError(
            "this would be a service of user root", fix="run it without sudo, or with " + Argument("system")
        )


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StorageError(f"cannot write: {error.strerror}", place=path) from error


def _installed_elsewhere(system: bool) -> Text:
    other = _Manager(system)
    if other.campaign() is None:
        if (PACKAGED_UNITS / NAME).exists():
            return f"the one of the package is stopped by: sudo systemctl disable --now {NAME}"
        return Action.INSTALL_SERVICE() + " installs one"
    return f"a {other.words} is: " + other.removal


def _warnings(unit: Unit) -> Iterator[str]:
    if is_temporary(unit.campaign):
        yield f"{unit.campaign} is emptied when the computer starts: move the campaign, then install again"
    if unit.owner == "root":
        remedy = "better: give the folder to another user (chown), then install again"
        yield f"the service runs as root, who owns {unit.campaign}; {remedy}"
    if unit.owner is None:
        yield from _user_warnings()


def _user_warnings() -> Iterator[str]:
    """Obstacles that keep a user's service from its instruments, or from starting at boot."""
    user = _user_name(os.geteuid())
    missing = [name for name in GROUPS if _is_group(name) and grp.getgrnam(name).gr_gid not in os.getgroups()]
    if missing:
        joined = f"sudo usermod --append --groups {','.join(missing)} {user}"
        yield f"without a login this user may not use the instruments: {joined}"
    if not _lingers():
        subprocess.run(["loginctl", "enable-linger"], capture_output=True, check=False)
    if not _lingers():
        yield f"the service starts at login only; at boot after: sudo loginctl enable-linger {user}"


def _lingers() -> bool:
    return (LINGERING / _user_name(os.geteuid())).exists()


def _user_name(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def _is_group(name: str) -> bool:
    try:
        grp.getgrnam(name)
    except KeyError:
        return False
    return True
