"""What the commands over many sessions share."""

import pytest

from fieldkit.cli import batch
from fieldkit.model.errors import ConfigError, SessionError
from fieldkit.results.result_files import write_results


def test_a_session_that_is_named_twice_fails_once_and_as_what_it_is(tmp_path):
    path = tmp_path / "a.h5"
    with pytest.raises(ConfigError, match="a mistake"):
        batch.raise_failures(
            {path: ConfigError("a mistake")}, [path, tmp_path / "." / "a.h5", tmp_path / "x/../a.h5"]
        )


def test_of_several_sessions_it_is_told_how_many_failed(tmp_path):
    paths = [tmp_path / "a.h5", tmp_path / "b.h5"]
    with pytest.raises(SessionError, match="1 of 2"):
        batch.raise_failures({paths[0]: ConfigError("a mistake")}, paths)
    batch.raise_failures({}, paths)


def test_a_spreadsheet_computes_nothing_of_a_table_of_results(tmp_path):
    columns = {"region": ["=1+1", "b05"], "tilt_deg": [-1.5, float("nan")]}
    write_results(tmp_path / "slopes", columns, {})
    lines = (tmp_path / "slopes.csv").read_text(encoding="utf-8").splitlines()
    assert lines == ["region,tilt_deg", "'=1+1,-1.5", "b05,"]
