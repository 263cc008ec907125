"""A recording leaves as streams of the Lab Streaming Layer, over real outlets and inlets on loopback.

What they send is written as LabRecorder would, in XDF with the header that LSL gives, and imported again.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import fieldkit
from fieldkit.config import FILE_NAME, load_config
from fieldkit.config.template import SIMULATED
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Site
from fieldkit.model.slope import SLOPE_FIELDS
from fieldkit.recording.campaign import create_campaign
from fieldkit.recording.record import prepare
from tests.harness.foreign_files import xdf, xdf_chunk, xdf_samples

WITHIN_S = 60.0
ON_LOOPBACK = """
[multicast]
ResolveScope = machine
AddressesOverride = {127.0.0.1}
MachineAddresses = {127.0.0.1}
[log]
level = -3
"""


@pytest.fixture(scope="module")
def lsl(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The library, which reads its configuration once, when it is loaded."""
    assert "pylsl" not in sys.modules, "loaded before it was kept to this machine"
    path = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    path.write_text(ON_LOOPBACK)
    os.environ["LSLAPICFG"] = str(path)
    yield pytest.importorskip("pylsl")
    del os.environ["LSLAPICFG"]


@dataclass
class Listener:
    """A view before that with the outlets: it opens an inlet to each stream, and collects what they send."""

    lsl: ModuleType
    names: tuple[str, ...]
    inlets: dict[str, Any] = field(default_factory=dict)
    silent: list[Any] = field(default_factory=list)
    headers: dict[str, str] = field(default_factory=dict)
    received: dict[str, list[tuple[float, list[Any]]]] = field(default_factory=dict)

    def show(self, item: object) -> None:
        if not self.inlets:
            self._open()
        for name, inlet in self.inlets.items():
            while (sample := inlet.pull_sample(timeout=0.0))[1] is not None:
                self.received[name].append((sample[1], sample[0]))

    def _open(self) -> None:
        for name in self.names:
            (stream,) = self.lsl.resolve_byprop("name", name, timeout=WITHIN_S)
            self.inlets[name], self.received[name] = self.lsl.StreamInlet(stream), []
            self.inlets[name].open_stream(timeout=WITHIN_S)
            self.headers[name] = self.inlets[name].info(timeout=WITHIN_S).as_xml()
            self.silent.append(self.lsl.StreamInlet(stream, max_buflen=1))  # connected, and never read
            self.silent[-1].open_stream(timeout=WITHIN_S)

    def close(self) -> None:
        """What is still on its way."""
        for name, inlet in self.inlets.items():
            while (sample := inlet.pull_sample(timeout=0.5))[1] is not None:
                self.received[name].append((sample[1], sample[0]))
        self.inlets.clear()
        self.silent.clear()


def test_readings_slopes_and_events_arrive_and_come_back_as_xdf(lsl: ModuleType, tmp_path: Path) -> None:
    create_campaign(tmp_path / "field", SIMULATED)
    settings = ["simulation.speed=max", "lux.every_s=4", "thermometer.every_s=4", "record.lsl=true"]
    config = load_config(tmp_path / "field" / FILE_NAME, settings=settings)
    listener = Listener(lsl, ("lux", "region b15", "events"))
    with prepare(config, duration_s=1200.0) as prepared:
        recorded = prepared.run([listener])
    assert recorded.summary.failure is None
    with fieldkit.open_session(recorded.path) as session:
        stored = session["lux"].readings()
        slopes = [one for one in session.estimates() if one.region == "b15"]
        events = {event.text for event in session.events()}
    came = listener.received["lux"]
    assert len(came) >= len(stored.values) - 1  # the first may come before the inlet
    assert [values for _, values in came] == stored.values[-len(came) :].tolist()
    after_s = np.diff(stored.time_ns[-len(came) :]) / 1e9
    np.testing.assert_allclose(np.diff([stamp for stamp, _ in came]), after_s, atol=1e-6)

    minutes = listener.received["region b15"]
    assert len(minutes) == len(slopes) > 10
    labels = ["temperature", *SLOPE_FIELDS]
    tilts = [values[labels.index("tilt_deg")] for _, values in minutes]
    np.testing.assert_array_equal(tilts, [slope.tilt_deg for slope in slopes])
    assert tilts[-1] == pytest.approx(15.0, abs=5.0)  # of the simulated bed
    assert {text for _, (text,) in listener.received["events"]} <= events

    path = tmp_path / "day.xdf"
    path.write_bytes(
        xdf(*(
            xdf_chunk(2, listener.headers[name].encode(), number)
            + xdf_chunk(3, xdf_samples(*zip(*listener.received[name], strict=True)), number)
            for number, name in enumerate(("lux", "region b15"), 1)
        ))
    )  # fmt: skip
    noon = Site(0.0, 30.0)  # where it is day at the date of the file, whatever day was simulated
    made = fieldkit.import_recording(path, tmp_path / "day.h5", fieldkit.ImportOptions(site=noon))
    with made.open() as imported:
        assert imported["lux"].readings().values.tolist() == stored.values[-len(came) :].tolist()
        kelvin = imported["region-b15"].readings().values.ravel()
        np.testing.assert_allclose(kelvin, [values[0] for _, values in minutes])


def test_outlets_that_cannot_be_made_leave_the_recording_alone(tmp_path: Path) -> None:
    """Ports as liblsl's documentation of lsl_api.cfg has them: all of a range of one are taken."""
    create_campaign(tmp_path / "field", SIMULATED)
    with socket.socket() as taken, socket.socket(socket.AF_INET6) as also_taken:
        taken.bind(("0.0.0.0", 0))
        port = taken.getsockname()[1]
        also_taken.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        also_taken.bind(("::", port))
        ports = f"[ports]\nBasePort = {port}\nPortRange = 1\nAllowRandomPorts = 0\n"
        (tmp_path / "lsl_api.cfg").write_text(ports + ON_LOOPBACK)
        done = subprocess.run(
            [sys.executable, "-m", "fieldkit", "record", "-C", tmp_path / "field", "--for", "1m", "--set",
             "simulation.speed=max", "--set", "record.lsl=true"],
            env={**os.environ, "LSLAPICFG": str(tmp_path / "lsl_api.cfg")}, capture_output=True, text=True,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "nothing is sent to the Lab Streaming Layer" in done.stderr
    assert list((tmp_path / "field/recordings").glob("*.h5"))


def test_without_the_library_the_recording_does_not_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create_campaign(tmp_path / "field", SIMULATED)
    config = load_config(tmp_path / "field" / FILE_NAME, settings=["record.lsl=true"])
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with (
        pytest.raises(ConfigError, match=r"record\.lsl needs pylsl") as refused,
        prepare(config, duration_s=60.0) as prepared,
    ):
        prepared.run()
    assert "fieldkit[lsl]" in (refused.value.fix or "")
    assert not list((tmp_path / "field").rglob("*.h5*"))
