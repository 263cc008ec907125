"""The text of the systemd unit that runs a campaign: what it starts, when again, and what it may touch."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fieldkit.model.errors import ConfigError

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
            raise ConfigError(f"{self.campaign!r} has a control character", fix="rename the folder")
        return "\n".join(
            [
                self.header,
                "[Unit]",
                *self._unit(),
                "",
                "[Service]",
                *self._service(),
                "",
                "[Install]",
                *self._install(),
            ]
        )

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

    def _install(self) -> Iterator[str]:
        yield f"WantedBy={'default.target' if self.owner is None else 'multi-user.target'}"
        yield ""


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


if __name__ == "__main__":
    sys.stdout.write(packaged_unit().text())
