"""Verified flags as an array that xarray reads when it is asked to; imported only where xarray is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from xarray.backends import BackendArray
from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

from fieldkit.model.arrays import FlagArray
from fieldkit.sessions.reader import open_session


def verified_flags(path: Path, stream: str, shape: tuple[int, ...]) -> LazilyIndexedArray:
    """`Quality` of a stream's samples; each read opens the session anew, which may be closed meanwhile."""
    return LazilyIndexedArray(_VerifiedFlags(path, stream, shape))


class _VerifiedFlags(BackendArray):
    def __init__(self, path: Path, stream: str, shape: tuple[int, ...]) -> None:
        self.path, self.stream, self.shape, self.dtype = path, stream, shape, np.dtype("<u4")

    def __getitem__(self, key: Any) -> Any:
        return explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._read)

    def _read(self, key: tuple[int | slice]) -> FlagArray:
        rows = np.arange(self.shape[0])[key]
        if not rows.size:
            return np.empty(0, self.dtype)
        first = int(rows.min())
        with open_session(self.path) as session:
            return session.stream(self.stream).flags(first, int(rows.max()) + 1)[rows - first]
