"""``xarray.open_dataset("field.h5", engine="fieldkit", group="camera")``: sessions as any other file.

xarray finds this class by the entry point ``xarray.backends`` of the package. Without `engine` its own
backends open every HDF5 file, with times and flags as stored. This module must not be imported elsewhere: it
needs xarray, which is optional.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import h5py
import xarray as xr
from xarray.backends import BackendEntrypoint

from fieldkit.sessions.analysis import to_xarray
from fieldkit.sessions.layout import FORMAT_NAME
from fieldkit.sessions.reader import attribute, open_session


class FieldkitBackend(BackendEntrypoint):
    """Opens one stream of a session: calibrated values, verified flags, times in UTC."""

    description = "Streams of fieldkit sessions"
    open_dataset_parameters: ClassVar[tuple[str, ...]] = ("filename_or_obj", "drop_variables", "group")

    def open_dataset(
        self,
        filename_or_obj: Any,
        *,
        drop_variables: str | Iterable[str] | None = None,
        group: str | None = None,
    ) -> xr.Dataset:
        """The stream named by `group`, which may be omitted where the session has only one.

        Raises `ValueError` where it has several, `SessionError` for anything that `fieldkit.open_session`
        or `Session.to_xarray` refuses.
        """
        with open_session(Path(filename_or_obj)) as session:
            if group is None and len(session.streams) > 1:
                raise ValueError(f"which stream? give group=, one of {', '.join(session.streams)}")
            dataset = to_xarray(session, group or next(iter(session.streams)))
        unwanted = [drop_variables] if isinstance(drop_variables, str) else drop_variables or ()
        return dataset.drop_vars(unwanted, errors="ignore")

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """True if it is the path of a session; every other HDF5 file is left to the other backends."""
        if not isinstance(filename_or_obj, str | os.PathLike):
            return False
        try:
            with h5py.File(filename_or_obj, "r") as file:
                return attribute(file, "fieldkit_format") == FORMAT_NAME
        except OSError:
            return False
