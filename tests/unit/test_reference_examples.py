"""The examples of the API reference: there is one for everything public, and each runs as printed."""

import doctest
import os
import pkgutil
import pty
import re
import shutil
import threading
import tty
from typing import Any

import pytest

import fieldkit
from fieldkit.drivers.identity import UsbIdentity
from tests.harness.connected import plugged_in
from tests.unit.test_face import REFERENCE, described

HIDDEN = re.findall(r'^ +filters: \["!\^_", "!(.*)"\]$', REFERENCE.read_text("utf-8"), re.MULTILINE)[0]
"""Members that the reference leaves out: parts of the session file for the project's own use."""
RECORDING = re.search(r"(?ms)^```python\n(.*?)^```", REFERENCE.read_text("utf-8"))
"""How the reference makes the campaign and the session of its examples."""


def examples_of(name: str) -> list[doctest.DocTest]:
    """What the docstrings of an object and its own members show."""
    found = pkgutil.resolve_name(name)
    members = vars(found).items() if isinstance(found, type) else ()
    parts = {name: found} | {
        f"{name}.{key}": getattr(one, "fget", one) for key, one in members if key[0] != "_"
    }
    parse = doctest.DocTestParser().get_doctest
    tests = [parse(getattr(one, "__doc__", None) or "", {}, where, where, 0) for where, one in parts.items()]
    return [test for test in tests if test.examples]


TESTS = {test.name: test for name in described() for test in examples_of(name)}


def callables(name: str) -> list[str]:
    """The methods of a class that the reference shows, inherited ones among them."""
    kinds = getattr(pkgutil.resolve_name(name), "__mro__", ())
    return [
        key
        for kind in kinds
        if kind.__module__.startswith("fieldkit")
        for key, one in vars(kind).items()
        if callable(one) and key[0] != "_" and not re.match(HIDDEN, key)
    ]


@pytest.mark.parametrize("name", described())
def test_everything_public_has_an_example(name):
    assert name in TESTS
    shown = "".join(example.source for example in TESTS[name].examples)
    missing = [key for key in callables(name) if f".{key}(" not in shown and f"{name}.{key}" not in TESTS]
    assert missing == []


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The folder of the campaign that the reference's examples use, recorded as the reference says."""
    folder = tmp_path_factory.mktemp("reference")
    assert RECORDING
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        names: dict[str, Any] = {}
        exec(RECORDING[1], names)
        names["session"].close()
    return folder


@pytest.fixture
def instruments(tmp_path, monkeypatch):
    """A serial adapter that is found, and a port `light-meter` on which a Lutron shows 638 lx in its tens."""
    adapter = ("/dev/ttyUSB0", UsbIdentity(0x10C4, 0xEA60, "A7", "1-2", "CP2102"))
    # what the pages show is connected, whatever is connected to this computer; only a kernel makes its nodes
    plugged_in(monkeypatch, serial_ports=[adapter])
    monkeypatch.setattr("fieldkit.drivers.ports.serial_ports", lambda: [("light-meter", adapter[1])])
    # drivers of others that are installed here
    monkeypatch.setattr("fieldkit.drivers.registry.load_all", lambda: ([], []))
    near, far = pty.openpty()
    tty.setraw(near)
    tty.setraw(far)
    (tmp_path / "light-meter").symlink_to(os.ttyname(far))
    done = threading.Event()

    def send() -> None:
        while not done.wait(0.2):
            os.write(near, b"\x0241150000000638\r")

    thread = threading.Thread(target=send)
    thread.start()
    yield
    done.set()
    thread.join()
    os.close(near)
    os.close(far)


@pytest.fixture
def names(recorded, tmp_path, monkeypatch):
    """What the examples may use, in a copy of the folder that is the current one."""
    shutil.copytree(recorded, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    campaign = fieldkit.open_campaign("sandslope", {"simulation.speed": "max"})
    with campaign["noon"] as session:
        yield {"fieldkit": fieldkit, "campaign": campaign, "session": session}


@pytest.mark.usefixtures("instruments")
@pytest.mark.parametrize("name", TESTS)
def test_the_example_gives_what_it_shows(name, names):
    test, printed = TESTS[name], []
    test.globs = names
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert runner.run(test, out=printed.append).failed == 0, "".join(printed)
