"""Install the wheel in new virtual environments and run an experiment in each.

``make test-wheel``: one environment for each Python that is installed, first bare, then with ``[lab]``; other
Pythons are named as skipped. ``make test-lowest``: with the lowest versions that pyproject.toml allows, and
the unit tests of what depends on libraries most. ``make test-newest``: the same with the newest versions.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build/wheel"
EXTRAS = "lab,alarms,dask,page,pdf,terrain"
LOWEST_PYTHON = "3.11"
UNIT_TESTS = ("physics", "config", "sessions", "test_face.py")

Run = Callable[..., str]


def main() -> int:
    """The number of Pythons in which something failed, as exit code."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("pythons", nargs="*", default=[sys.executable])
    options.add_argument("--lowest", dest="test", action="store_const", const=try_lowest, default=try_wheel)
    options.add_argument("--newest", dest="test", action="store_const", const=try_newest)
    given = options.parse_args()
    (wheel,) = (ROOT / "dist").glob("fieldkit_slope-*.whl")
    results = {python: outcome(python, wheel, given.test) for python in given.pythons}
    print(*(f"{python}: {result}" for python, result in results.items()), sep="\n")
    if all(result.startswith("skipped") for result in results.values()):
        return 1
    return sum(result == "failed" for result in results.values())


def outcome(python: str, wheel: Path, test: Callable[[Run, Path, Path], None]) -> str:
    """``passed``, ``failed``, or ``skipped`` and why."""
    try:
        asked = [python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
        version = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "skipped: not installed"
    folder = BUILD / f"{test.__name__}-{version}"
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    try:
        test(commands_in(folder), wheel, folder)
    except subprocess.CalledProcessError as error:
        print(error.stdout or "", f"{error.cmd} ended with {error.returncode}", sep="\n")
        return "failed"
    return "passed"


def commands_in(folder: Path) -> Run:
    """What runs a program of the environment, outside the checkout, and gives what it prints."""

    def run(program: str, *words: object, at: Path = folder) -> str:
        print(f"$ {program}", *words, flush=True)
        command = [folder / "venv/bin" / program, *map(str, words)]
        return subprocess.run(command, cwd=at, check=True, stdout=subprocess.PIPE, text=True).stdout

    return run


def try_wheel(run: Run, wheel: Path, folder: Path) -> None:
    """The demo in a bare environment, its report with the figures of ``[lab]``."""
    run("pip", "install", "--quiet", wheel)
    print(run("fieldkit", "--version"))
    print(run("fieldkit", "demo", "--quiet"))
    (session,) = (folder / "demo/recordings").glob("*.h5")
    run("fieldkit", "check", session)
    run("pip", "install", "--quiet", f"{wheel}[lab]")
    run("fieldkit", "report", session, "-o", folder / "report.html")
    if "<svg" not in (folder / "report.html").read_text(encoding="utf-8"):
        raise subprocess.CalledProcessError(1, "looking for figures in the report")


def try_lowest(run: Run, wheel: Path, folder: Path) -> None:
    """With the lowest versions that pyproject.toml allows."""
    lowest = folder / "lowest.txt"
    resolve = ("uv", "pip", "compile", "--quiet", "--resolution=lowest-direct", "--all-extras")
    python = f"--python-version={LOWEST_PYTHON}"
    subprocess.run([*resolve, python, ROOT / "pyproject.toml", "--output-file", lowest], check=True)
    # old libraries warn of what newer Pythons and NumPy will not do later
    _try_all(run, wheel, folder, ("--constraint", lowest), ("--override-ini", "filterwarnings=default"))


def try_newest(run: Run, wheel: Path, folder: Path) -> None:
    """The same with the newest versions, which come without constraints; a warning is an error."""
    _try_all(run, wheel, folder)


def _try_all(
    run: Run, wheel: Path, folder: Path, versions: Sequence[object] = (), options: Sequence[str] = ()
) -> None:
    """An experiment and unit tests with these versions."""
    run("pip", "install", "--quiet", "--upgrade", "pip>=25.1")  # the first with --group
    run("pip", "install", "--quiet", *versions, f"{wheel}[{EXTRAS}]")
    run("pip", "install", "--quiet", *versions, "--group", f"{ROOT / 'pyproject.toml'}:test")
    try_wheel(run, wheel, folder)
    tests = [f"tests/unit/{name}" for name in UNIT_TESTS]
    print(run("python", "-m", "pytest", "--quiet", "-m", "not slow", *options, *tests, at=ROOT))


if __name__ == "__main__":
    sys.exit(main())
