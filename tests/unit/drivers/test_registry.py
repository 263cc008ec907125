import subprocess
import sys
from math import nan

import pytest

from fieldkit.drivers import registry
from fieldkit.model.clock import HostClock
from fieldkit.model.device import DeviceSettings
from fieldkit.model.errors import ConfigError
from tests.harness.next_steps import at
from tests.harness.plugins import install


@pytest.fixture
def site_packages(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", registry.BUILT_IN)
def test_option_that_a_driver_has_not_is_refused_for_instruments_and_for_bytes(name):
    wrong = {"latencys_s": 1}
    with pytest.raises(ConfigError) as opening:
        registry.open_device(DeviceSettings("mine", name, port="/dev/none", options=wrong), HostClock())
    with pytest.raises(ConfigError) as decoding:
        registry.decode(name, b"", wrong)
    assert "latency_s?" in opening.value.fix
    assert opening.value.fix == decoding.value.fix


def test_driver_of_another_package_is_found_by_its_entry_point(site_packages):
    install(site_packages, "sample-meter", "sample")
    assert "sample" in registry.names()
    assert type(registry.get("sample")).__name__ == "JSONDecoder"


@pytest.mark.parametrize(
    ("name", "packages"), [("same", ("first-meter", "second-meter")), ("lutron", ("my-lutron",))]
)
def test_name_of_two_packages_or_of_ours_is_refused_with_the_packages(site_packages, name, packages):
    for package in packages:
        install(site_packages, package, name)
    with pytest.raises(ConfigError, match=".* ".join(packages), check=at(name)):
        registry.get(name)


def test_broken_package_is_a_problem_not_an_end(site_packages):
    install(site_packages, "broken-meter", "broken", "no_such_module:Driver")
    drivers, problems = registry.load_all()
    assert {driver.name for driver in drivers} == set(registry.BUILT_IN)
    (problem,) = problems
    assert problem.startswith("broken: ")
    assert "broken-meter" in problem


def test_listing_the_names_loads_no_driver():
    code = (
        "import sys; from fieldkit.drivers import registry; registry.names();"
        "heavy = ('cv2', 'serial', 'usb', 'fieldkit.drivers.meters', 'fieldkit.drivers.cameras');"
        "print([name for name in heavy if name in sys.modules])"
    )
    reply = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert reply.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("name", "noise_k"), [("purethermal", 0.1), ("mlx90640", 0.2), ("lutron", nan), ("nobody", nan)]
)
def test_the_noise_of_a_camera_is_its_drivers_figure(name, noise_k):
    assert registry.noise_k(name) == pytest.approx(noise_k, nan_ok=True)
