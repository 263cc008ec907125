"""What the verbs over many sessions share."""

from __future__ import annotations

from pathlib import Path

import pytest

from fieldkit.commands import batch
from fieldkit.errors import ConfigError, SessionError


def test_a_session_that_is_named_twice_fails_once_and_as_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with pytest.raises(ConfigError, match="a mistake"):
        batch.complain(
            {path: ConfigError("a mistake")}, [path, tmp_path / "." / "a.h5", tmp_path / "x/../a.h5"]
        )


def test_of_several_sessions_it_is_told_how_many_failed(tmp_path: Path) -> None:
    paths = [tmp_path / "a.h5", tmp_path / "b.h5"]
    with pytest.raises(SessionError, match="1 of 2 sessions could not be estimated"):
        batch.complain({paths[0]: ConfigError("a mistake")}, paths)
    batch.complain({}, paths)
