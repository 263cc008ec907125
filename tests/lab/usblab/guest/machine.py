"""The emulated computer: QEMU's command line, its sockets, its beginning and its end."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from usblab.guest import image, initramfs, kernel, packages
from usblab.program import Program

CAMERA_PORTS = 3
PROCESSORS = 2
SERIAL_NUMBERS = ("LUX0001", "TMP0001", "LUX0002")
SOFTWARE = ("tcg,thread=multi", "max,avx2=off", 180.0)
"""QEMU's AVX2 is wrong: with it numpy.argsort returns a wrong order, or ends the program by SIGSEGV."""
HARDWARE = ("kvm", "host,-arch-capabilities", 15.0)
ONE_CLOCK = "tsc=reliable"
"""Of two emulated processors the kernel distrusts the time stamp counters, though they are one."""


def accelerations() -> list[tuple[str, str, float]]:
    """What to boot with, in order: acceleration, processor, how long to wait for the guest's hello."""
    usable = os.access("/dev/kvm", os.R_OK | os.W_OK) and os.environ.get("USBLAB_ACCEL") != "tcg"
    return [HARDWARE, SOFTWARE] if usable else [SOFTWARE]


class GuestError(RuntimeError):
    """The guest did not start, does not answer, or an operation in it failed."""


class Guest:
    """A running guest; a context manager that leaves no process and no file behind.

    `cache` is a folder for kernel and root image; `program` goes into the guest. `clock_base` is the guest's
    UTC at power-on ("2016-01-01T19:00:00"). `prepare` is called with the guest before its processor starts,
    to plug in what is to be found at power-on. Hardware virtualisation is tried first where /dev/kvm may be
    used; USBLAB_ACCEL=tcg skips that.
    """

    def __init__(
        self,
        cache: Path,
        program: Program,
        clock_base: str,
        prepare: Callable[[Guest], None] = lambda _: None,
    ) -> None:
        self.program = program
        self._cache, self._clock_base, self._prepare = cache, clock_base, prepare
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: socket.socket | None = None
        self._rest = b""
        self._jobs = 0
        self.boot_s = 0.0

    def __enter__(self) -> Guest:
        packages.need_processor()
        packages.need_programs("qemu-system-x86_64", "mksquashfs", "dpkg-deb", "ldd")
        self._cache.mkdir(parents=True, exist_ok=True)
        self._kernel = kernel.prepare(self._cache)
        self._root = image.prepare(self._cache, self.program.distribution)
        self.home = Path(tempfile.mkdtemp(prefix="fk-", dir="/tmp"))  # socket paths must stay below 108 bytes
        try:
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._halt()
        shutil.rmtree(self.home, ignore_errors=True)

    def camera_socket(self, number: int) -> Path:
        """Where a camera is plugged in: connecting plugs, closing unplugs."""
        return self.home / f"cam{number}"

    def serial_socket(self, number: int) -> Path:
        """Where a meter is plugged in; `SERIAL_NUMBERS` names its adapter."""
        return self.home / f"ser{number}"

    def ask(self, operation: str, timeout_s: float = 120.0, **arguments: Any) -> Any:
        """One operation of the guest's command loop, see `usblab.inside.agent.Agent`."""
        if self._channel is None:
            raise GuestError("the guest is not running")
        request = {"do": operation, "with": arguments}
        self._channel.sendall(json.dumps(request).encode() + b"\n")
        answer = json.loads(self._line(timeout_s))
        if "error" in answer:
            raise GuestError(answer["error"])
        return answer["result"]

    def call(self, function: str, timeout_s: float = 120.0, **arguments: Any) -> Any:
        """Call a function inside the guest: ``module:name`` with JSON arguments."""
        return self.ask("call", timeout_s, function=function, arguments=arguments)

    def console(self) -> str:
        """What the kernel and the boot scripts printed."""
        path = self.home / "console"
        return path.read_text(errors="replace") if path.exists() else ""

    def _start(self) -> None:
        archive = initramfs.build(self._kernel, self.program)
        (self.home / "initramfs").write_bytes(archive)
        for acceleration, processor, patience_s in accelerations():
            begun = time.monotonic()
            if self._boot(acceleration, processor, patience_s):
                self.boot_s = time.monotonic() - begun
                return
            self._halt()
        raise GuestError(f"the guest did not come up:\n{self.console()[-2000:]}")

    def _boot(self, acceleration: str, processor: str, patience_s: float) -> bool:
        """Whether the command loop says hello in time; a present /dev/kvm proves nothing."""
        command = self._command(acceleration, processor)
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        deadline = time.monotonic() + patience_s
        try:
            self._channel = self._connect(self.home / "channel", deadline)
            self._prepare(self)
            return json.loads(self._line(deadline - time.monotonic()))["result"] == "hello"
        except GuestError:
            return False

    def _halt(self) -> None:
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _connect(self, path: Path, deadline: float) -> socket.socket:
        while time.monotonic() < deadline:
            if self._process is not None and self._process.poll() is not None:
                raise GuestError("QEMU ended at once")
            try:
                channel = socket.socket(socket.AF_UNIX)
                channel.connect(str(path))
                return channel
            except (FileNotFoundError, ConnectionRefusedError):
                channel.close()
                time.sleep(0.05)  # QEMU makes the socket without a sign
        raise GuestError(f"QEMU opened no {path.name}")

    def _line(self, timeout_s: float) -> bytes:
        assert self._channel is not None
        deadline = time.monotonic() + timeout_s
        while b"\n" not in self._rest:
            self._channel.settimeout(max(0.01, deadline - time.monotonic()))
            try:
                received = self._channel.recv(1 << 20)
            except TimeoutError:
                raise GuestError(f"no answer within {timeout_s:.0f} s:\n{self.console()[-2000:]}") from None
            if not received:
                raise GuestError(f"the guest is gone:\n{self.console()[-2000:]}")
            self._rest += received
        line, self._rest = self._rest.split(b"\n", 1)
        return line

    def _command(self, acceleration: str, processor: str) -> list[str]:
        def chardev(name: str) -> str:
            return f"socket,id={name},path={self.home / name},server=on,wait=off"

        command = [
            "qemu-system-x86_64", "-accel", acceleration, "-cpu", processor,
            "-M", "q35", "-smp", str(PROCESSORS), "-m", "2048",
            "-nodefaults", "-no-user-config", "-display", "none", "-no-reboot",
            "-rtc", f"base={self._clock_base}",
            "-kernel", str(self._kernel.image), "-initrd", str(self.home / "initramfs"),
            "-append", f"console=ttyS0 quiet loglevel=4 panic=-1 mitigations=off {ONE_CLOCK}",
            "-serial", f"file:{self.home / 'console'}",
            "-drive", f"file={self._root},format=raw,if=virtio,readonly=on",
            "-device", "qemu-xhci,id=xhci,p2=8,p3=4",
            "-device", "virtio-serial-pci", "-chardev", chardev("channel"),
            "-device", "virtserialport,chardev=channel,name=usblab",
        ]  # fmt: skip
        for number in range(CAMERA_PORTS):
            command += ["-chardev", chardev(f"cam{number}")]
            command += ["-device", f"usb-redir,chardev=cam{number},id=u-cam{number},bus=xhci.0"]
        for number, serial_number in enumerate(SERIAL_NUMBERS):
            command += ["-chardev", chardev(f"ser{number}")]
            adapter = f"usb-serial,chardev=ser{number},id=u-ser{number},serial={serial_number},bus=xhci.0"
            command += ["-device", adapter]
        return command
