"""What a session's file declares of itself: format, version, header; and how damage is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from fieldkit.model.errors import SessionError
from fieldkit.sessions.header import SessionHeader
from fieldkit.sessions.layout import FORMAT_NAME, FORMAT_VERSION, decode_text
from fieldkit.sessions.stored import stored_here
from fieldkit.sessions.superblock import CHECK_PATH

_MAX_HEADER_BYTES = 16_000_000


def explained(path: Path, error: Exception) -> SessionError:
    """What is wrong, with which session, and what to do next."""
    known = isinstance(error, SessionError) and str(path) in str(error)
    fix = getattr(error, "fix", None) or f"fieldkit recover {path}"
    return SessionError(str(error) if known else f"{path} is damaged: {error}", fix=fix)


def check_format(path: Path, file: h5py.File) -> None:
    """Raise `SessionError` where the file is no session, or one of a newer version."""
    if attribute(file, "fieldkit_format") != FORMAT_NAME:
        raise SessionError(f"{path} is an HDF5 file, but not a fieldkit session", fix=CHECK_PATH)
    version = str(attribute(file, "fieldkit_format_version"))
    if version.split(".")[0] != FORMAT_VERSION.split(".")[0]:
        raise SessionError(
            f"{path} has format version {version}; this fieldkit reads {FORMAT_VERSION}",
            fix="install a newer fieldkit: pip install --upgrade fieldkit",
        )


def attribute(file: h5py.File, name: str) -> str | None:
    """A root attribute as text, or None where there is none."""
    value = file.attrs.get(name)
    return value.decode(errors="replace") if isinstance(value, bytes) else value


def scalar(file: h5py.File, name: str) -> Any:
    """A single value of this very file; raises `SessionError` where there is none or a hostile one."""
    dataset = stored_here(file, name)
    is_scalar = isinstance(dataset, h5py.Dataset) and dataset.shape == ()
    if not is_scalar or dataset.dtype.itemsize > _MAX_HEADER_BYTES:
        raise SessionError(f"{file.filename}: {name} is missing")
    return dataset[()]


def header_of(file: h5py.File) -> SessionHeader:
    """What was declared when the recording began; raises `SessionError` where it is damaged."""
    return SessionHeader.from_json(decode_text(scalar(file, "config/header")))
