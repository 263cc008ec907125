"""The fixtures of the virtual USB lab: one guest for the whole run, or a reason why there is none."""

import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from fieldlab.campaign import CAMERA_BY_ID  # noqa: E402
from fieldlab.field import START, Field  # noqa: E402
from fieldlab.program import fieldkit  # noqa: E402
from usblab.guest.machine import Guest  # noqa: E402
from usblab.guest.missing import MissingPartError  # noqa: E402
from usblab.lab import Lab  # noqa: E402
from usblab.models.purethermal import PureThermal  # noqa: E402
from usblab.port import UsbPort  # noqa: E402

CACHE = HERE.parents[1] / ".cache/lab"


@pytest.fixture(scope="session")
def field():
    """The simulated field all instruments look at."""
    return Field()


@pytest.fixture(scope="session")
def _booted(field):
    """A guest that found a camera plugged in when it was switched on, and what udev made of that."""
    early: list[UsbPort] = []

    def plug_early(guest: Guest) -> None:
        """For each attempt to boot: without usable hardware virtualisation there are two."""
        if early:
            early.pop().unplug()
        early.append(UsbPort(PureThermal(field.lepton), guest.camera_socket(0)))
        early[-1].plug()

    try:
        with Guest(CACHE, fieldkit(field.scene.site), START, plug_early) as guest:
            lab = Lab(guest)
            lab.wait_for(CAMERA_BY_ID)
            found = dict(lab.nodes())
            early[-1].unplug()
            lab.wait_for_empty_sockets()
            field.follow(lab.utc_ns)
            yield lab, found
    except MissingPartError as reason:
        pytest.skip(str(reason))


@pytest.fixture(scope="session")
def lab(_booted):
    """The lab with nothing plugged in."""
    return _booted[0]


@pytest.fixture(autouse=True)
def _unplugged_after(lab):
    """What a test plugged in and out again is gone in the guest before the next one begins."""
    yield
    lab.wait_for_empty_sockets()


@pytest.fixture(scope="session")
def cold_plugged(_booted):
    """The nodes of a camera that was plugged in when the guest was switched on."""
    return _booted[1]
