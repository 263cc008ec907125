"""An RO-Crate as its reference library reads it, and what the standard and DataCite ask of it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from rocrate import rocrate

from fieldkit.sessions.formats.ro_crate_out import export_ro_crate
from fieldkit.sessions.reader import open_session
from tests.harness.recording import header, recorded

CITED = replace(
    header((24, 32)),
    title="Sand beds",
    operator="A. Nonymous",
    license="CC-BY-4.0",
    references="doi:10.1000/1",
)


def crate(folder: Path, campaign: str) -> list[Path]:
    recorded(folder / "field.h5", replace(CITED, config_toml=campaign), 1)
    with open_session(folder / "field.h5") as session:
        return export_ro_crate(session, folder)


def entities(files: list[Path]) -> dict[str, dict]:
    return {entity["@id"]: entity for entity in json.loads(files[-1].read_text(encoding="utf-8"))["@graph"]}


def test_the_root_has_what_the_standard_demands(tmp_path):
    # RO-Crate 1.1, "Root Data Entity": name, description, datePublished, license
    files = crate(tmp_path, "")
    found = entities(files)
    assert found["ro-crate-metadata.json"]["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    root = found["./"]
    assert (root["@type"], root["name"]) == ("Dataset", "Sand beds")
    assert root.keys() >= {"description", "datePublished"}
    assert root["license"] == {"@id": "https://spdx.org/licenses/CC-BY-4.0"}
    assert root["citation"] == "doi:10.1000/1"
    assert found[root["author"]["@id"]]["name"] == "A. Nonymous"
    assert [part["@id"] for part in root["hasPart"]] == [path.name for path in files[:-1]]
    for path in files[:-1]:
        assert found[path.name]["contentSize"] == str(path.stat().st_size)


@pytest.mark.parametrize("is_exact", [False, True])
def test_the_place_is_rounded_unless_it_may_be_known(tmp_path, is_exact):
    site = CITED.site
    geo = entities(crate(tmp_path, f"[campaign]\nexact_place = {str(is_exact).lower()}\n"))["#geo"]
    found = geo["latitude"], geo["longitude"]
    exact = site.latitude_deg, site.longitude_deg
    assert (found == exact) == is_exact
    assert found == pytest.approx(exact, abs=0.05)
    assert ("elevation" in geo) == is_exact


def test_the_reference_library_reads_it(tmp_path):
    crate(tmp_path, "")
    read = rocrate.ROCrate(tmp_path)
    assert read.name == "Sand beds"
    assert read.root_dataset["author"]["name"] == "A. Nonymous"
    assert {part.id for part in read.data_entities} == {path.name for path in tmp_path.glob("*.csv")}
