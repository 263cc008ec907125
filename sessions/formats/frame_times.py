"""Times of frames, where they are given beside them: in a table, or in the names of their files."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from datetime import tzinfo
from pathlib import Path

from fieldkit.model.errors import ConfigError
from fieldkit.sessions.formats.times import parse_times_ns

GIVE_TIMES = '--times stamps.csv (file name, time), or --time-format "%Y%m%dT%H%M%S" (in the names)'


def given_times_ns(
    frames: Mapping[Path, int], times: Path | None, time_format: str | None, zone: tzinfo | None
) -> dict[Path, list[int]] | None:
    """The times of the frames of each file by a table or by its name; None where neither is to be used.

    Parameters
    ----------
    frames : mapping
        Number of frames in each file.
    times : Path, optional
        Table of file name and time, a line per frame, with a header line or without.
    time_format : str, optional
        Format of the times in the file names without their ending, as for strptime.
    zone : tzinfo, optional
        Zone of times without an offset.

    Returns
    -------
    dict or None
        Of each file, the times of its frames in their order. [ns, UTC]

    Raises
    ------
    ConfigError
        Both are given, a zone without them, or they do not give each frame its time.
    """
    if times is not None and time_format is not None:
        raise ConfigError("give the times of the frames in one way only", fix=GIVE_TIMES)
    if times is not None:
        return _from_table(frames, times, zone)
    if time_format is not None:
        return _from_names(frames, time_format, zone)
    if zone is not None:
        raise ConfigError("--zone has no effect: the times in the files are UTC", fix="omit --zone")
    return None


def _from_table(frames: Mapping[Path, int], times: Path, zone: tzinfo | None) -> dict[Path, list[int]]:
    by_name = {path.name: path for path in frames}
    rows = [(by_name[name], time) for name, time in _rows(times) if name in by_name]
    found: dict[Path, list[int]] = {path: [] for path in frames}
    for (path, _), time_ns in zip(rows, parse_times_ns([time for _, time in rows], zone), strict=True):
        found[path].append(time_ns)
    wrong = [path for path, count in frames.items() if len(found[path]) != count]
    if wrong:
        first = f"{wrong[0].name}: {len(found[wrong[0]])} times for {frames[wrong[0]]} frames"
        raise ConfigError(
            f"{times} does not give each frame of {len(wrong)} files its time, the first {first}",
            fix="give every frame a line with its file's name and its time, in their order in the file",
        )
    return found


def _rows(times: Path) -> list[tuple[str, str]]:
    try:
        lines = times.read_text(encoding="utf-8-sig").splitlines()
        cells = csv.reader(lines, delimiter=_delimiter(lines))
        return [(row[0].strip(), row[1].strip()) for row in cells if len(row) >= 2]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"cannot read {times}: {error}", fix="save it as CSV, UTF-8") from error


def _delimiter(lines: Sequence[str]) -> str:
    """Separator of the columns: semicolons or tabs where the first line has them, else commas."""
    return next((mark for mark in ";\t" if lines and mark in lines[0]), ",")


def _from_names(frames: Mapping[Path, int], time_format: str, zone: tzinfo | None) -> dict[Path, list[int]]:
    several = next((path for path, count in frames.items() if count > 1), None)
    if several is not None:
        raise ConfigError(
            f"{several} has {frames[several]} frames, its name only one time",
            fix="--times stamps.csv, with a line for each: file name, time",
        )
    times_ns = parse_times_ns([path.stem for path in frames], zone, time_format)
    return {path: [time_ns] for path, time_ns in zip(frames, times_ns, strict=True)}
