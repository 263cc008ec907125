"""Results of earlier runs, found again by what they were made of: session content, parameters, code.

Entries lie in the user's cache folder and may be deleted at any time. Each begins with a checksum of the
rest, and a damaged one is made again. Nothing in them is executed: they hold arrays alone.
"""

from __future__ import annotations

import functools
import hashlib
import io
import json
import logging
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray
from pydantic import TypeAdapter

import fieldkit.estimation
import fieldkit.model
import fieldkit.physics
import fieldkit.sessions
from fieldkit.disk import replacing
from fieldkit.model.arrays import AnyArray
from fieldkit.model.version import __version__

Arrays = dict[str, AnyArray]

PACKAGES = ("numpy", "scipy", "astropy", "h5py")
"""Libraries whose version can change the last digits of a slope."""

_HERE = ("cache", "minutes", "session_estimates", "sources", "together")
"""Files of this room that the numbers depend on."""

_CHECKSUM_BYTES = hashlib.sha256().digest_size
_log = logging.getLogger(__name__)


class Cache:
    """A folder of entries, each one set of arrays under the digest of what it was made of.

    It stays empty where no checksum vouches for a session: it is its journal alone, or goes on.
    """

    def __init__(self, folder: Path | None = None, *, checksums: Sequence[str] = ()) -> None:
        self.folder: Path = folder or platformdirs.user_cache_path("fieldkit") / "estimates"
        self._is_used = all(checksums)

    def load(self, key: str) -> Arrays | None:
        """The arrays stored under a key; None if there are none or they are damaged."""
        if not self._is_used:
            return None
        try:
            entry = self._path(key).read_bytes()
        except OSError:
            return None
        checksum, packed = entry[:_CHECKSUM_BYTES], entry[_CHECKSUM_BYTES:]
        if hashlib.sha256(packed).digest() != checksum:
            _log.warning("an entry of %s is damaged; it is computed again", self.folder)
            return None
        try:
            with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
                return {name: arrays[name] for name in arrays.files}
        except ValueError:  # objects, which are never executed
            return None

    def store(self, key: str, arrays: Mapping[str, AnyArray]) -> None:
        """Store arrays; if the write fails, the next run takes longer and nothing else happens."""
        if not self._is_used:
            return
        packed = io.BytesIO()
        np.savez(packed, **arrays)  # type: ignore[arg-type]  # names of arrays are not its options
        path = self._path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path, synced=False) as draft:
                draft.write_bytes(hashlib.sha256(packed.getbuffer()).digest() + packed.getbuffer())
        except OSError as error:
            _log.warning("cannot keep results in %s: %s", self.folder, error.strerror)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.arrays"


def as_text(value: Any) -> NDArray[np.bytes_]:
    """A value of dataclasses, lists and dictionaries as JSON in an array, every number exact."""
    return np.array([json.dumps(value, default=asdict)], np.bytes_)


def of_text(kind: Any, text: AnyArray) -> Any:
    """The value of type `kind` that `as_text` made a text of."""
    return _adapter(kind).validate_json(text.item())


@functools.cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)  # made once: it takes longer than a text of three hours


def digest(*made_of: object) -> str:
    """SHA-256 of what something was made of; dataclasses, numbers and texts by their exact ``repr``."""
    return hashlib.sha256(repr((code_version(), *made_of)).encode()).hexdigest()


@functools.cache
def code_version() -> str:
    """Version of fieldkit and a digest of everything that a slope's digits depend on.

    That is the source code of the packages from session to slope, and `PACKAGES` on this machine.
    """
    digest = hashlib.sha256(platform.machine().encode())
    for package in PACKAGES:
        digest.update(f"{package} {metadata.version(package)}".encode())
    for file in sorted(_sources(), key=lambda file: (file.parent.name, file.name)):
        digest.update(file.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:12]}"


def _sources() -> list[Path]:
    """The files that numbers come from: laws, bins and slopes, and how samples are read from a session.

    What writes sessions is not among them, nor what shows results.
    """
    rooms = (fieldkit.estimation, fieldkit.model, fieldkit.physics)
    within = [file for room in rooms for file in Path(room.__path__[0]).rglob("*.py")]
    reading = Path(fieldkit.sessions.__path__[0]).glob("*.py")
    here = [Path(__file__).with_name(f"{name}.py") for name in _HERE]
    house = Path(fieldkit.__path__[0])
    return [*within, *reading, *here, *house.glob("*.py"), *(house / "data").glob("sobol-*.csv")]
