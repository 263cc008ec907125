"""What packages and citations state about fieldkit agrees with the code."""

import importlib.metadata
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from click.shell_completion import BashComplete
from click.testing import CliRunner

import fieldkit
from fieldkit.cli import main
from fieldkit.model import installation
from fieldkit.recording.service import GROUPS

ROOT = Path(__file__).parents[2]
CONDA_NAMES = {"astropy": "astropy-base", "isal": "python-isal", "opencv-python-headless": "py-opencv"}
"""What conda-forge calls packages that have another name there."""


@pytest.mark.parametrize("name", ["codemeta.json", ".zenodo.json"])
def test_metadata_is_of_this_version_and_these_keywords(name):
    stated = json.loads((ROOT / name).read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (stated["version"], stated["keywords"]) == (fieldkit.__version__, project["keywords"])


def test_everything_to_be_cited_has_the_version_and_date_of_the_changelog():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    (date,) = re.findall(rf"(?m)^## {re.escape(fieldkit.__version__)} \((\S+)\)", changelog)
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {fieldkit.__version__}\ndate-released: {date}\n" in cited
    for name, key in (("codemeta.json", "datePublished"), (".zenodo.json", "publication_date")):
        assert json.loads((ROOT / name).read_text(encoding="utf-8"))[key] == date


def test_the_conda_recipe_has_this_version_and_these_dependencies():
    recipe = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    needs = [one.partition(">=") for one in project["project"]["dependencies"]]
    named = {f"{CONDA_NAMES.get(name, name)} >={version}" for name, _, version in needs}
    assert recipe["package"]["version"] == fieldkit.__version__
    assert set(recipe["requirements"]["run"]) == {"python >=3.11", "libusb", "hdf5 >=2.0", *named}
    built_with = {one.replace(">=", " >=") for one in project["build-system"]["requires"]}
    assert set(recipe["requirements"]["host"]) == {"python >=3.11", "pip", *built_with}


def test_the_debian_user_is_in_the_groups_of_the_unit():
    lines = (ROOT / "packaging/debian/sysusers.conf").read_text(encoding="utf-8").splitlines()
    assert {tuple(line.split()) for line in lines[1:]} == {("m", "fieldkit", name) for name in GROUPS}


def man_pages() -> dict[str, str]:
    spec = importlib.util.spec_from_file_location("man_pages", ROOT / "packaging/man_pages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.man_pages()


@pytest.mark.parametrize(
    "judge", [("mandoc", "-Tlint", "-Wwarning"), ("man", "--warnings=w", "-Tutf8", "-Z", "--local-file")]
)
def test_no_program_for_man_pages_warns_of_ours(judge, tmp_path):
    if shutil.which(judge[0]) is None:
        pytest.skip(f"{judge[0]} is not installed")
    pages = [tmp_path / name for name in man_pages()]
    for path, text in zip(pages, man_pages().values(), strict=True):
        path.write_text(text, encoding="utf-8")
    environment = {**os.environ, "LC_ALL": "C.UTF-8"}
    done = subprocess.run([*judge, *pages], capture_output=True, text=True, env=environment)
    warnings = done.stdout if judge[0] == "mandoc" else done.stderr
    assert (done.returncode, warnings) == (0, "")


def test_a_shell_is_offered_commands_without_importing_one():
    completion = BashComplete(main, {}, "fieldkit", "_FIELDKIT_COMPLETE")
    before = set(sys.modules)
    found = {item.value: item.help for item in completion.get_completions([], "rec")}
    assert found == {name: main.summaries[name] for name in ("record", "recover")}
    assert not {name for name in set(sys.modules) - before if name.startswith("fieldkit.cli.")}
    assert "--for" in {item.value for item in completion.get_completions(["record"], "--")}


def test_version_names_the_commit_that_is_checked_out():
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("this is not a checkout")
    head = subprocess.run(
        ["git", "-C", ROOT, "rev-parse", "HEAD"], capture_output=True, text=True, check=True
    )
    printed = CliRunner().invoke(main, ["--version"]).output
    assert printed.startswith(f"fieldkit {fieldkit.__version__} (commit {head.stdout[:12]}")
    assert printed.endswith(f"checkout {ROOT.resolve()})\n")


@pytest.mark.parametrize(
    ("records", "said"),
    [
        ({"INSTALLER": "pip\n", "direct_url.json": '{"url": "file:///a/kit-1.whl"}'}, "wheel /a/kit-1.whl"),
        ({"INSTALLER": "pip\n", "direct_url.json": '{"url": "file:///a/fieldkit"}'}, "source /a/fieldkit"),
        ({"INSTALLER": "uv\n"}, "installed by uv from a package index"),
        ({"INSTALLER": "dpkg\n"}, "Debian package"),
    ],
)
def test_version_says_where_an_installation_came_from(records, said, tmp_path, monkeypatch):
    """PEP 610: direct_url.json is there unless it came from an index; PEP 376: INSTALLER."""
    for name, text in records.items():
        (tmp_path / name).write_text(text)
    stamp = tmp_path / "commit.txt"
    stamp.write_text("0123456789ab\n")
    # tests/wheel.py installs for real, but from a file alone
    monkeypatch.setattr(installation, "STAMP", stamp)
    installed = importlib.metadata.PathDistribution(tmp_path)
    monkeypatch.setattr(importlib.metadata, "distribution", lambda name: installed)
    assert installation.origin() == f"commit 0123456789ab, {said}"


def wheel_of(folder: Path) -> Path:
    """A wheel of the project, built in isolation and dated as its archives are."""
    pip_wheel = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"]
    command = [sys.executable, *pip_wheel, str(folder), str(ROOT)]
    subprocess.run(command, check=True, env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}, timeout=600)
    return next(folder.glob("fieldkit_slope-*.whl"))


@pytest.mark.slow
def test_a_wheel_built_again_is_equal_and_holds_the_whole_package(tmp_path):
    first, again = wheel_of(tmp_path / "first"), wheel_of(tmp_path / "again")
    assert first.read_bytes() == again.read_bytes()
    package = ROOT / "fieldkit"
    linked = [package / room for room in ("calibration", "drivers", "sessions")]
    files = {file.relative_to(ROOT) for room in (package, *linked) for file in room.rglob("*.py")}
    held = zipfile.ZipFile(first)
    assert {str(file) for file in files} <= set(held.namelist())
    assert held.read("fieldkit/commit.txt").decode().strip() == installation.origin().split()[1].rstrip(",")
    share = f"fieldkit_slope-{fieldkit.__version__}.data/data/share"
    pages = (f"man/man1/{name}" for name in man_pages())
    scripts = ("bash-completion/completions/fieldkit", "zsh/site-functions/_fieldkit", *pages)
    assert {f"{share}/{script}" for script in scripts} <= set(held.namelist())
