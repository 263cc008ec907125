"""An RO-Crate as its reference library reads it, and what the standard and DataCite ask of it."""

import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from itertools import chain
from pathlib import Path

import pytest
from rocrate import rocrate

import fieldkit
from fieldkit.model.errors import ConfigError
from fieldkit.sessions.formats.ro_crate_out import export_ro_crate
from fieldkit.sessions.reader import open_session
from tests.harness.recording import header, recorded

ORCID = "0000-0002-1825-0097"  # the example of orcid.org
CITED = replace(
    header((24, 32)),
    title="Sand beds",
    operator="A. Nonymous",
    license="CC-BY-4.0",
    references="doi:10.1000/1",
)


def crate(folder: Path, campaign: str) -> list[Path]:
    (folder / "crate").mkdir()
    recorded(folder / "field.h5", replace(CITED, config_toml=campaign), 1)
    with open_session(folder / "field.h5") as session:
        return export_ro_crate(session, folder / "crate", license="CC-BY-4.0", orcid=ORCID)


def entities(files: list[Path]) -> dict[str, dict]:
    return {entity["@id"]: entity for entity in json.loads(files[-1].read_text(encoding="utf-8"))["@graph"]}


def references(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        yield from (
            [value["@id"]]
            if value.keys() == {"@id"}
            else chain.from_iterable(map(references, value.values()))
        )
    elif isinstance(value, list):
        yield from chain.from_iterable(map(references, value))


def test_a_crate_has_all_that_the_standard_requires(tmp_path):
    """RO-Crate 1.1: the sentences with MUST of "Root Data Entity", "Data Entities" and "JSON-LD"."""
    files = crate(tmp_path, "")
    document = json.loads(files[-1].read_text(encoding="utf-8"))
    assert document["@context"] == "https://w3id.org/ro/crate/1.1/context"
    found = entities(files)
    assert len(found) == len(document["@graph"])  # flat, each once
    assert all({"@id", "@type"} <= entity.keys() for entity in document["@graph"])
    descriptor, root = found["ro-crate-metadata.json"], found["./"]
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert (descriptor["@type"], descriptor["about"]) == ("CreativeWork", {"@id": "./"})
    assert (root["@type"], root["name"]) == ("Dataset", "Sand beds")
    assert root["description"]
    assert date.fromisoformat(root["datePublished"])
    assert root["license"] == {"@id": "https://spdx.org/licenses/CC-BY-4.0"}
    assert found[root["license"]["@id"]]["name"] == "CC-BY-4.0"
    assert set(references(document["@graph"])) - {"https://w3id.org/ro/crate/1.1"} <= found.keys()
    assert [part["@id"] for part in root["hasPart"]] == [path.name for path in files[:-1]]
    for path in files[:-1]:
        assert (found[path.name]["@type"], path.parent) == ("File", files[-1].parent)
        assert found[path.name]["contentSize"] == str(path.stat().st_size)


@pytest.mark.parametrize("is_exact", [False, True])
def test_the_place_is_rounded_where_it_may_not_be_known(tmp_path, is_exact):
    site = CITED.site
    files = crate(tmp_path, f"[campaign]\nexact_place = {str(is_exact).lower()}\n")
    geo = entities(files)["#geo"]
    found = geo["latitude"], geo["longitude"]
    exact = site.latitude_deg, site.longitude_deg
    assert (found == exact) == is_exact
    assert found == pytest.approx(exact, abs=0.05)
    assert ("elevation" in geo) == is_exact
    assert ("field.h5" in {path.name for path in files}) == is_exact  # it has the place


def test_the_reference_library_reads_it_with_its_author_and_session(tmp_path):
    files = crate(tmp_path, "")
    read = rocrate.ROCrate(files[-1].parent)
    author = read.root_dataset["author"]
    assert (read.name, read.root_dataset["citation"]) == ("Sand beds", "doi:10.1000/1")
    assert (author.id, author["name"]) == (f"https://orcid.org/{ORCID}", "A. Nonymous")
    assert {part.id for part in read.data_entities} == {path.name for path in files[:-1]}
    assert files[0].read_bytes() == (tmp_path / "field.h5").read_bytes()


def test_a_licence_is_asked_for_once_and_kept_in_the_campaign(tmp_path):
    campaign = fieldkit.init_campaign(tmp_path / "beds")
    path = campaign.directory / "recordings" / "field.h5"
    recorded(path, replace(CITED, license=""), 1)
    with pytest.raises(ConfigError) as error:
        fieldkit.export(path, "ro-crate")
    assert error.value.fix
    fieldkit.export(path, "ro-crate", license="CC0-1.0")
    assert fieldkit.open_campaign(campaign.directory).config.tables.campaign.license == "CC0-1.0"
    files = fieldkit.export(path, "ro-crate").files
    assert entities(list(files))["./"]["license"] == {"@id": "https://spdx.org/licenses/CC0-1.0"}
