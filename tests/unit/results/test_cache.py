import logging
from pathlib import Path

import numpy as np
import pytest

from fieldkit.physics.energy_balance import SurfaceParameters
from fieldkit.results import cache as cache_module
from fieldkit.results.cache import Cache, code_version, digest
from tests.harness.command_line import run_code


def test_what_was_stored_is_found_to_the_bit(tmp_path):
    arrays = {"x": np.array([0.1, np.nan, -0.0]), "texts": np.array(["a", "°"], np.str_)}
    Cache(tmp_path).store("abc", arrays)
    found = Cache(tmp_path).load("abc")
    assert found is not None
    assert {name: found[name].tobytes() for name in found} == {
        name: arrays[name].tobytes() for name in arrays
    }


def test_an_entry_that_was_cut_or_in_which_any_bit_flipped_is_as_if_it_were_not_there(tmp_path):
    cache = Cache(tmp_path)
    cache.store("abc", {"x": np.arange(3.0), "names": np.array(["a", "b"])})
    (entry,) = tmp_path.rglob("*.arrays")
    whole = entry.read_bytes()
    flipped = (
        whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1 :]
        for place in range(len(whole))
    )
    for damaged in (b"", whole[: len(whole) // 2], b"PK" + bytes(50), *flipped):
        entry.write_bytes(damaged)
        assert cache.load("abc") is None
    assert cache.load("never stored") is None


def test_an_entry_is_never_executed(tmp_path):
    cache = Cache(tmp_path)
    cache.store("abc", {"x": np.array([{"an": "object"}], dtype=object)})
    assert cache.load("abc") is None


def test_a_disk_that_refuses_costs_a_warning(tmp_path, caplog):
    (tmp_path / "file").write_text("in the way")
    with caplog.at_level(logging.WARNING):
        Cache(tmp_path / "file").store("abc", {"x": np.zeros(1)})
    assert [record.levelname for record in caplog.records] == ["WARNING"]


def test_keys_follow_content_and_are_the_same_in_another_process():
    assert digest("session", SurfaceParameters()) == digest("session", SurfaceParameters())
    assert digest("session", SurfaceParameters()) != digest("session", SurfaceParameters(albedo=0.2000001))
    code = "from fieldkit.results.cache import digest; print(digest('session', 0.1))"
    assert run_code(code).strip() == digest("session", 0.1)


@pytest.fixture
def fresh_version():
    """The version as of now, not of the first time it was asked."""
    code_version.cache_clear()
    yield lambda: (code_version.cache_clear(), code_version())[1]
    code_version.cache_clear()


# --- other libraries, another machine, other code: a real one of each would be an installation of its own


@pytest.mark.parametrize("package", ["numpy", "scipy", "astropy", "h5py"])
def test_results_of_other_libraries_are_not_found(monkeypatch, fresh_version, package):
    before, of = fresh_version(), cache_module.metadata.version
    monkeypatch.setattr(cache_module.metadata, "version", lambda name: "0.1" if name == package else of(name))
    assert fresh_version() != before


def test_results_of_another_kind_of_machine_are_not_found(monkeypatch, fresh_version):
    before = fresh_version()
    monkeypatch.setattr(cache_module.platform, "machine", lambda: "riscv64")
    assert fresh_version() != before


@pytest.mark.parametrize(
    "file",
    [
        "fieldkit/model/samples.py",
        "fieldkit/model/site.py",
        "fieldkit/estimation/balance.py",
        "fieldkit/estimation/learned/filters.py",
        "fieldkit/data/sobol-5.csv",
        "fieldkit/physics/sun.py",
        "fieldkit/sessions/stream_reader.py",
        "fieldkit/results/minutes.py",
    ],
)
def test_results_of_other_code_are_not_found(monkeypatch, fresh_version, file):
    """One line more in any module between session and slope."""
    before, genuine = fresh_version(), Path.read_bytes
    changed = (Path(cache_module.__file__).parents[2] / file).resolve()
    monkeypatch.setattr(Path, "read_bytes", lambda path: genuine(path) + b"\n" * (path.resolve() == changed))
    assert fresh_version() != before


def test_every_key_depends_on_the_version(monkeypatch):
    before = digest("session", 0.1)
    monkeypatch.setattr(cache_module, "code_version", lambda: "another")
    assert digest("session", 0.1) != before
