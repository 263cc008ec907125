"""A session as an RO-Crate for archives: its file and tables, described by ``ro-crate-metadata.json``.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) is JSON-LD in the words of schema.org, of which Zenodo and other
archives fill DataCite's fields: creators, titles, rights, descriptions, related items, dates, place, formats.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fieldkit.disk import replacing
from fieldkit.model.site import Site
from fieldkit.model.version import __version__
from fieldkit.sessions.file_tree import iso_utc
from fieldkit.sessions.formats.tables_out import export_csv, write_json
from fieldkit.sessions.reader import SessionReader

METADATA = "ro-crate-metadata.json"
VERSION = "https://w3id.org/ro/crate/1.1"
PLACE_DECIMALS = 1
"""Of the place where the exact one is not to be published: to about ten kilometres."""
FORMATS = {".h5": "application/x-hdf5", ".csv": "text/csv", ".json": "application/json"}
_SPDX = "https://spdx.org/licenses/"


def export_ro_crate(session: SessionReader, folder: Path, *, license: str, orcid: str = "") -> list[Path]:
    """Write a session, its tables and their description into a folder, which becomes the crate.

    `license` is an SPDX identifier, an address or words; `orcid` the operator's. Without the exact place the
    session, which states it, is not in the crate.
    """
    files = export_csv(session, folder)
    copy = folder / session.path.name
    if _is_exact(session.header.config_toml) and session.path.exists():
        if copy.resolve() != session.path.resolve():
            with replacing(copy, synced=False) as draft:
                shutil.copyfile(session.path, draft)
        files = [copy, *files]
    graph = list(_entities(session, files, license, orcid))
    return [*files, write_json(folder / METADATA, {"@context": f"{VERSION}/context", "@graph": graph})]


def _entities(
    session: SessionReader, files: Sequence[Path], license: str, orcid: str
) -> Iterator[dict[str, Any]]:
    """The descriptor, the dataset, and what they refer to."""
    header = session.header
    author = f"https://orcid.org/{orcid}" if orcid else "#operator" if header.operator else ""
    address = f"{_SPDX}{license}" if re.fullmatch(r"[\w.+-]+", license) else license
    address = address if ":" in address and " " not in address else "#license"
    yield {"@id": METADATA, "@type": "CreativeWork", "conformsTo": {"@id": VERSION}, "about": {"@id": "./"}}
    yield _dataset(session, files, author, address)
    for file in files:
        about = {"encodingFormat": FORMATS[file.suffix], "contentSize": str(file.stat().st_size)}
        yield {"@id": file.name, "@type": "File", "name": file.stem, **about}
    yield {"@id": address, "@type": "CreativeWork", "name": license}
    if author:
        yield {"@id": author, "@type": "Person", "name": header.operator or orcid}
    if header.site.body == "earth":
        yield {"@id": "#place", "@type": "Place", "geo": {"@id": "#geo"}}
        yield _coordinates(header.site, is_exact=_is_exact(header.config_toml))
    else:  # GeoCoordinates are of the Earth
        yield {"@id": "#place", "@type": "Place", "name": header.site.body}
    software = {"name": "fieldkit", "version": __version__}
    yield {"@id": "#fieldkit", "@type": "SoftwareApplication", **software}
    yield {
        "@id": "#export", "@type": "CreateAction", "instrument": {"@id": "#fieldkit"},
        "object": session.path.name, "result": {"@id": "./"},
    }  # fmt: skip


def _dataset(session: SessionReader, files: Sequence[Path], author: str, license: str) -> dict[str, Any]:
    """The root: what RO-Crate demands (name, description, date, licence), and what is known beyond."""
    header = session.header
    title = header.title or session.path.stem
    optional = {"author": {"@id": author} if author else "", "citation": header.references}
    return {
        "@id": "./",
        "@type": "Dataset",
        "name": title,
        "identifier": f"urn:uuid:{session.session_id}",
        "description": header.description or f"{title}: readings and slopes recorded by fieldkit",
        "license": {"@id": license},
        "datePublished": f"{datetime.now(UTC):%Y-%m-%d}",
        "temporalCoverage": f"{iso_utc(session.start_ns)}/{iso_utc(session.end_ns)}",
        "spatialCoverage": {"@id": "#place"},
        "variableMeasured": sorted({info.quantity for info in header.streams}),
        "hasPart": [{"@id": file.name} for file in files],
        **{name: value for name, value in optional.items() if value},
    }


def _is_exact(config_toml: str) -> bool:
    """Whether the campaign publishes its exact place."""
    return bool(tomllib.loads(config_toml).get("campaign", {}).get("exact_place", True))


def _coordinates(site: Site, *, is_exact: bool) -> dict[str, Any]:
    """WGS 84, rounded unless the exact place is asked for."""
    latitude, longitude = site.latitude_deg, site.longitude_deg
    if not is_exact:
        latitude, longitude = round(latitude, PLACE_DECIMALS), round(longitude, PLACE_DECIMALS)
    geo = {"@id": "#geo", "@type": "GeoCoordinates", "latitude": latitude, "longitude": longitude}
    return {**geo, "elevation": site.elevation_m} if is_exact else geo
