"""A campaign as a service of systemd: the text of its unit, and how it is installed and removed.

``systemctl status fieldkit`` shows how it is doing.

There is one service, `NAME`, for the user or for the system: its campaign has the instruments.
"""

from __future__ import annotations

import grp
import logging
import os
import pwd
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from fieldkit.config import Config
from fieldkit.model.errors import ConfigError, RefusedError
from fieldkit.model.next_step import Action, Argument, Step, Text
from fieldkit.recording.preflight import Notify
from fieldkit.results.result_files import writing

NAME = "fieldkit.service"
GROUPS = ("video", "dialout", "plugdev")
"""Groups that the udev rules give the instruments to."""
MODULES = ("usbserial", "cdc_acm", "uvcvideo")
"""Kernel modules of instruments: only when loaded do their classes of devices exist, and can be allowed."""
TEMPORARY = ("/tmp", "/var/tmp")
"""Folders of which a system service has its own, empty ones: ``PrivateTmp=``, systemd.exec(5)."""
DEVICES = ("video4linux", "ttyUSB", "ttyACM", "ttyAMA", "ttyS", "usb_device")
"""Classes of devices, as ``/proc/devices`` names them, to which instruments belong."""

WRITTEN = "# Written by fieldkit service install, which replaces it."
HARDENING = """\
NoNewPrivileges=yes
LockPersonality=yes
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged @resources
SystemCallErrorNumber=EPERM
UMask=0027
"""
"""Privileges that a service of a user may give up too, for which systemd needs no privilege."""

SYSTEM_HARDENING = """\
CapabilityBoundingSet=
AmbientCapabilities=
ProtectSystem=strict
ProtectHome=read-only
PrivateTmp=yes
PrivateMounts=yes
ProtectProc=invisible
ProtectClock=yes
ProtectHostname=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
KeyringMode=private
DevicePolicy=closed
"""
"""The rest, for a system service: it opens no other devices and writes nowhere but in the campaign."""


@dataclass(frozen=True, slots=True)
class Unit:
    """Purpose and settings of a unit.

    `owner` is the name of the user whom a system service runs as, None for the user's own service; `groups`
    are those that give it the instruments. `record` begins a recording at boot; `page` are options of
    ``fieldkit page``, such as ``("--address", "192.168.4.1")``. `python` runs the program; `header` is a
    comment.
    """

    campaign: Path
    owner: str | None = None
    groups: Sequence[str] = ()
    record: bool = False
    page: Sequence[str] = ()
    python: str = sys.executable
    header: str = WRITTEN

    def text(self) -> str:
        """The unit file. Raises `ConfigError` for a folder with a line break in its name."""
        if not str(self.campaign).isprintable():
            raise ConfigError(
                "has a control character", place=repr(str(self.campaign)), fix="rename the folder without it"
            )
        target = "default.target" if self.owner is None else "multi-user.target"
        sections = {"Unit": self._unit(), "Service": self._service(), "Install": [f"WantedBy={target}"]}
        texts = ("\n".join([f"[{name}]", *lines]) for name, lines in sections.items())
        return f"{self.header}\n" + "\n\n".join(texts) + "\n"

    def _unit(self) -> Iterator[str]:
        yield f"Description=fieldkit in {_verbatim(self.campaign)}"
        yield "# without a campaign it fails at once; otherwise systemd would try again and again"
        yield f"AssertPathExists={_verbatim(self.campaign)}/fieldkit.toml"
        if self.owner is not None:
            modules = " ".join(f"modprobe@{name}.service" for name in MODULES)
            yield f"Wants={modules}"
            yield f"After=network.target time-sync.target {modules}"
            yield f"RequiresMountsFor={_word(self.campaign)}"

    def _service(self) -> Iterator[str]:
        yield "Type=notify"
        yield "# a recording is a child process and reports its own progress"
        yield "NotifyAccess=all"
        yield "WatchdogSec=60"
        yield f"WorkingDirectory={_verbatim(self.campaign)}"
        yield "# lost samples are reported by recover and must not keep the next recording from beginning"
        yield f"ExecStartPre=-{self._command('recover')}"
        yield f"ExecStart={self._command('page', *(['--record'] if self.record else []), *self.page)}"
        yield "# long sessions take minutes to recover on a small computer"
        yield "TimeoutStartSec=15min"
        yield "# stopping seals the session"
        yield "TimeoutStopSec=2min"
        yield "Restart=on-failure"
        yield "RestartSec=10"
        yield "# a wrong option or configuration needs a person"
        yield "RestartPreventExitStatus=2 3"
        yield "SyslogIdentifier=fieldkit"
        yield from HARDENING.splitlines()
        if self.owner is not None:
            yield from self._system_service(self.owner)

    def _command(self, *words: str) -> str:
        # -P: the campaign folder must not come before the program's own modules
        command = " ".join(_word(word) for word in (self.python, "-P", "-m", "fieldkit", *words))
        return command.replace("$", "$$")  # only commands have variables

    def _system_service(self, owner: str) -> Iterator[str]:
        yield f"User={owner}"
        if self.groups:
            yield f"SupplementaryGroups={' '.join(self.groups)}"
        yield from SYSTEM_HARDENING.splitlines()
        yield from (f"DeviceAllow=char-{name} rw" for name in DEVICES)
        yield f"ReadWritePaths={_word(self.campaign)}"
        if is_temporary(self.campaign):
            yield f"BindPaths={_word(self.campaign)}"
        if is_temporary(program := Path(self.python).parents[1]):
            yield f"BindReadOnlyPaths={_word(program)}"
        yield "CacheDirectory=fieldkit"
        yield "StateDirectory=fieldkit"
        yield "# the home folder is read-only"
        yield "Environment=XDG_CACHE_HOME=%C/fieldkit XDG_STATE_HOME=%S/fieldkit MPLCONFIGDIR=%C/fieldkit"


def is_temporary(folder: Path) -> bool:
    """True if a folder is below those that are emptied when the computer starts."""
    return any(folder.is_relative_to(above) for above in TEMPORARY)


def campaign_of(text: str) -> Path:
    """The campaign folder of a unit's text."""
    line = next(line for line in text.splitlines() if line.startswith("WorkingDirectory="))
    return Path(line.partition("=")[2].replace("%%", "%"))


def _verbatim(text: object) -> str:
    """Text of a value that is not divided into words; ``%`` would begin a specifier."""
    return str(text).replace("%", "%%")


def _word(text: object) -> str:
    """One word of a value, quoted where systemd would divide it."""
    escaped = _verbatim(text).replace("\\", "\\\\").replace('"', '\\"')
    return escaped if re.fullmatch(r"[\w/.,=@+-]+", escaped, re.ASCII) else f'"{escaped}"'


def packaged_unit() -> Unit:
    """The unit in a distribution's package: its campaign is in ``/var/lib/fieldkit``."""
    return Unit(
        Path("/var/lib/fieldkit/campaign"),
        "fieldkit",
        GROUPS,
        python="/usr/lib/fieldkit/bin/python3",
        header="# Of the package fieldkit; for another campaign: fieldkit service install --system",
    )


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
    groups = [group.gr_name for group in _groups()] if system else []
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
            f"is installed for {other}",
            place=NAME,
            fix=manager.removal + ", then install it",
        )
    with writing(manager.unit):
        manager.unit.write_text(text, encoding="utf-8")
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
                f"failed: {error.stderr.strip()}", place=" ".join(command), fix=self._fix()
            ) from None
        except subprocess.TimeoutExpired:
            raise RefusedError("did not finish", place=" ".join(command), fix=self._fix()) from None
        return process.stdout

    def _fix(self) -> str:
        if self.is_system:
            return f"journalctl --unit {NAME}"
        return "log in as this user, not by su or sudo; or install a system service"


def _need_rights(system: bool, command: str) -> None:
    if not SYSTEMD_RUNS.is_dir():
        raise RefusedError(
            "systemd does not run on this computer, so there is no service",
            fix="start the page, or a recording, by hand or by this computer's own init program",
        )
    is_root = os.geteuid() == 0
    if system and not is_root:
        raise RefusedError(
            f"only root may {command} a system service",
            place=Argument("system"),
            fix="use sudo and the full path of the command, or omit " + Argument("system"),
        )
    if is_root and not system:
        raise RefusedError(
            "this would be a service of user root", fix="run it without sudo, or with " + Argument("system")
        )


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
    if missing := [group.gr_name for group in _groups() if group.gr_gid not in os.getgroups()]:
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


def _groups() -> list[grp.struct_group]:
    """Those of `GROUPS` that this computer has, in their order."""
    present = {group.gr_name: group for group in grp.getgrall()}
    return [present[name] for name in GROUPS if name in present]


if __name__ == "__main__":
    sys.stdout.write(packaged_unit().text())
