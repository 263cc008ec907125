"""A campaign as a service of systemd: install it, remove it, and find out how it is doing.

There is one service, `service_unit.NAME`, for the user or for the system: its campaign has the instruments.
"""

from __future__ import annotations

import grp
import json
import logging
import os
import pwd
import subprocess
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from fieldkit.config import Config
from fieldkit.model.errors import RefusedError, StorageError
from fieldkit.model.units import SECOND_NS
from fieldkit.recording.preflight import Notify
from fieldkit.recording.service_unit import GROUPS, NAME, Unit, campaign_of, is_temporary, page_options_of

SYSTEMD_RUNS = Path("/run/systemd/system")
"""Exists where systemd is the init process, see sd_booted(3)."""
SYSTEM_UNITS = Path("/etc/systemd/system")
PACKAGED_UNITS = Path("/usr/lib/systemd/system")
"""Folder of the unit of a distribution's package; one of the same name in `SYSTEM_UNITS` replaces it."""
LINGERING = Path("/var/lib/systemd/linger")
"""A file for each user whose services run without a login."""
PROPERTIES = ("ActiveState", "SubState", "UnitFileState", "StatusText", "Result", "NRestarts",
              "StateChangeTimestamp")  # fmt: skip
PATIENCE_S = 300.0
"""Stopping the service seals its session first."""
SETTLED_WITHIN_S = 15.0
"""A service that starts normally is running, and one that cannot start has failed, within that time."""
log: logging.Logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of the service's log in the journal, and when it was written (UTC)."""

    time_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class ServiceStatus:
    """Status of an installed service.

    `page` are options of ``fieldkit page``; `state` and `substate` are systemd's words, such as ``active``
    and ``running``; `reports` is what the service last reported, `result` why it last ended, `since_ns`
    (UTC) when its state changed; None where systemd does not know.
    """

    unit: Path
    is_system: bool
    campaign: Path
    page: tuple[str, ...]
    starts_at_boot: bool
    state: str
    substate: str
    reports: str
    result: str
    restarts: int
    since_ns: int | None
    last_log: LogLine | None


def unit_of(config: Config, *, system: bool = False, record: bool = False, page: Sequence[str] = ()) -> Unit:
    """The unit that would be installed for a campaign; a system service runs as the folder's owner."""
    groups = [name for name in GROUPS if _is_group(name)] if system else []
    owner = _user_name(config.directory.stat().st_uid) if system else None
    return Unit(config.directory, owner, groups, record, page)


def install_service(unit: Unit, notify: Notify = log.warning) -> ServiceStatus:
    """Write a unit, start it now and at every boot; the same campaign's unit is replaced.

    `notify` receives what a person must still do. Raises `RefusedError` without systemd, without rights, or
    if the service is installed for another campaign, `StorageError` if the unit cannot be written.
    """
    text, is_system = unit.text(), unit.owner is not None
    _need_rights(is_system, "install")
    manager = _Manager(is_system)
    if (other := manager.campaign()) not in (None, unit.campaign):
        raise RefusedError(
            f"{NAME} is installed for {other}",
            fix=f"fieldkit service remove{manager.option}, then install it",
        )
    _write(manager.unit, text)
    manager.systemctl("daemon-reload")
    manager.systemctl("enable", NAME)
    manager.systemctl("restart", "--no-block", NAME)
    for warning in _warnings(unit):
        notify(warning)
    return _settled(manager)


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


def service_status() -> list[ServiceStatus]:
    """The installed services, the user's and the system's; raises `RefusedError` without systemd."""
    _need_systemd()
    found = [_Manager(system) for system in (False, True)]
    return [manager.status() for manager in found if manager.effective_unit().exists()]


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
    def option(self) -> str:
        return " --system" if self.is_system else ""

    def campaign(self) -> Path | None:
        """The campaign of the unit that `install_service` wrote, None without one."""
        return campaign_of(self.unit.read_text(encoding="utf-8")) if self.unit.exists() else None

    def effective_unit(self) -> Path:
        """The unit that systemd uses: a package's, where none was installed."""
        packaged = PACKAGED_UNITS / NAME
        return packaged if self.is_system and not self.unit.exists() and packaged.exists() else self.unit

    def systemctl(self, *words: str) -> str:
        command = ["systemctl", *([] if self.is_system else ["--user"]), *words]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
        except subprocess.CalledProcessError as error:
            raise RefusedError(
                f"{' '.join(command)} failed: {error.stderr.strip()}", fix=self._fix()
            ) from None
        except subprocess.TimeoutExpired:
            raise RefusedError(f"{' '.join(command)} did not finish", fix=self._fix()) from None
        return done.stdout

    def _fix(self) -> str:
        if self.is_system:
            return f"journalctl --unit {NAME}"
        return "log in as this user, not by su or sudo; or install a system service: --system"

    def status(self) -> ServiceStatus:
        wanted = f"--property={','.join(PROPERTIES)}"
        lines = self.systemctl("show", "--timestamp=unix", wanted, NAME).splitlines()
        shown = dict(line.split("=", 1) for line in lines if "=" in line)
        since = shown.get("StateChangeTimestamp", "").removeprefix("@")
        unit = self.effective_unit()
        text = unit.read_text(encoding="utf-8")
        return ServiceStatus(
            unit=unit,
            is_system=self.is_system,
            campaign=campaign_of(text),
            page=page_options_of(text),
            starts_at_boot=shown.get("UnitFileState") == "enabled" and (self.is_system or _lingers()),
            state=shown.get("ActiveState", ""),
            substate=shown.get("SubState", ""),
            reports=shown.get("StatusText", ""),
            result=shown.get("Result", ""),
            restarts=int(shown.get("NRestarts") or 0),
            since_ns=int(since) * SECOND_NS if since.isdigit() else None,
            last_log=self._last_log(),
        )

    def _last_log(self) -> LogLine | None:
        unit = f"--unit={NAME}" if self.is_system else f"--user-unit={NAME}"
        command = ["journalctl", "--quiet", "--no-pager", "--output=json", "--lines=1", unit]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
            entry = json.loads(done.stdout)
            return LogLine(int(entry["__REALTIME_TIMESTAMP"]) * 1000, str(entry["MESSAGE"]))
        except (OSError, ValueError, KeyError):  # no journal, no right to read it, or nothing in it
            return None


def _need_systemd() -> None:
    if not SYSTEMD_RUNS.is_dir():
        raise RefusedError(
            "systemd does not run on this computer, so there is no service",
            fix="fieldkit page, or fieldkit record, started by hand or by this computer's own init program",
        )


def _need_rights(system: bool, command: str) -> None:
    _need_systemd()
    is_root = os.geteuid() == 0
    if system and not is_root:
        raise RefusedError(
            f"only root may {command} a system service",
            fix=f"sudo $(command -v fieldkit) service {command} --system; or without --system as this user",
        )
    if is_root and not system:
        raise RefusedError(
            "this would be a service of the user root", fix="run it without sudo, or add --system"
        )


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}") from error


def _installed_elsewhere(system: bool) -> str:
    other = _Manager(system)
    if other.campaign() is None:
        if _Manager(True).effective_unit().exists():
            return f"the one of the package is stopped by: sudo systemctl disable --now {NAME}"
        return "fieldkit service install installs one"
    return f"a {other.words} is: fieldkit service remove{other.option}"


def _settled(manager: _Manager) -> ServiceStatus:
    deadline = time.monotonic() + SETTLED_WITHIN_S
    while (status := manager.status()).state == "activating" and time.monotonic() < deadline:
        time.sleep(0.5)
    return status


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
