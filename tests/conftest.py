"""For all tests: time for what hypothesis tries, and one recording that many of them read."""

import os
import shutil
from collections.abc import Callable, Generator
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from platformdirs import user_cache_path

from tests.harness.command_line import succeed
from tests.harness.once import folder_of_run, made_once
from tests.shared_data import NO_SHARED_DATA

# what hypothesis tries may take as long as a busy computer needs
settings.register_profile("thorough", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("quick", settings.get_profile("thorough"), max_examples=15)
settings.load_profile("quick")

ALL_REQUIRED = "FIELDKIT_ALL_REQUIRED"
RECORD = ("record", "--for", "12m", "--name", "short", "-q", "--set", "simulation.speed=max", "-C")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where everything is installed, as in continuous integration, only missing hardware excuses a skip."""
    report = yield
    excused = item.get_closest_marker("hardware") or NO_SHARED_DATA in str(report.longrepr)
    if report.skipped and os.environ.get(ALL_REQUIRED) and not excused and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped although {ALL_REQUIRED} is set: {report.longrepr}"
    return report


@pytest.fixture(scope="session", autouse=True)
def announcements_stay_here() -> Generator[None]:
    """Instruments are looked for on the loopback alone."""
    with pytest.MonkeyPatch.context() as patch:
        if find_spec("zeroconf"):
            patch.setattr("zeroconf.Zeroconf", partial(import_module("zeroconf").Zeroconf, ["127.0.0.1"]))
        yield


@pytest.fixture(scope="session", autouse=True)
def own_home(tmp_path_factory: pytest.TempPathFactory) -> Generator[None]:
    """Tests neither read nor change the configuration, cached results and logs of the user who runs them."""
    home = folder_of_run(tmp_path_factory) / "home"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MPLCONFIGDIR", str(user_cache_path("matplotlib")))  # its list of fonts takes seconds
        for name in ("CACHE", "CONFIG", "STATE"):
            (home / name.lower()).mkdir(parents=True, exist_ok=True)  # astropy warns where one is missing
            patch.setenv(f"XDG_{name}_HOME", str(home / name.lower()))
        yield


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """A session of twelve simulated minutes in a campaign of its own, in the folder that is given."""
    original = made_once(tmp_path_factory, "recorded", record)

    def copy(folder: Path) -> Path:
        shutil.copytree(original, folder, dirs_exist_ok=True)
        (session,) = (folder / "recordings").glob("*.h5")
        return session

    return copy


def record(folder: Path) -> None:
    for words in (("init", "--simulated"), RECORD):
        succeed(*words, folder)
