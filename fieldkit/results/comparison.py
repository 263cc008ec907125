"""Two estimates of the same sessions side by side: which regions moved, by how much, and what differed."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldkit.model.errors import ConfigError, message_of
from fieldkit.model.slope import WITH_SLOPE, final_rows
from fieldkit.phrases import counted
from fieldkit.results.batch import EstimatedSessions
from fieldkit.results.result_files import earlier_results

if TYPE_CHECKING:
    import pandas as pd

_WITH_SLOPE = {state.name.lower() for state in WITH_SLOPE}


@dataclass(frozen=True, slots=True)
class Move:
    """The final slope of a region in two estimates: by how much it moved from the `other` to this one.

    Angles in degrees, NaN where one of the two has none; `moved_half_widths` by the half-width of this one.
    """

    session: str
    region: str
    other_tilt_deg: float
    tilt_deg: float
    moved_deg: float
    moved_half_widths: float
    azimuth_moved_deg: float
    other_state: str
    state: str


@dataclass(frozen=True, repr=False)
class Comparison:
    """Two estimates of the same sessions: `moves`, the largest first, and `differences` between them.

    `differences` has the other's value and this one's by what differs: each setting, the code's version,
    marks without effect, the content of sessions that were changed in between, as a corrected mark does.

    >>> comparison = fieldkit.compare(june, "results/june")                          # doctest: +SKIP
    >>> comparison.to_frame(), comparison.document()                                 # doctest: +SKIP
    """

    moves: tuple[Move, ...]
    differences: Mapping[str, tuple[str, str]]

    def document(self) -> dict[str, Any]:
        """The comparison for ``--json``."""
        return {"moves": list(map(asdict, self.moves)), "differences": dict(self.differences)}

    def to_frame(self) -> pd.DataFrame:
        """The moves as a pandas frame; needs ``fieldkit-slope[lab]``."""
        import pandas as pd

        return pd.DataFrame(map(asdict, self.moves), columns=[field.name for field in fields(Move)])

    def __repr__(self) -> str:
        differences = ", ".join(self.differences) or "no difference"
        return f"<Comparison of {counted(len(self.moves), 'slope')}: {differences}>"


def compare(estimates: EstimatedSessions, other: EstimatedSessions | str | Path) -> Comparison:
    """Compare estimates of several sessions with others, or with the files that an estimate wrote.

    `other` are estimates, or the base of those files: ``"results/base"``. Raises `ConfigError` if there are
    no such files, or nothing that both estimated.

    Examples
    --------
    >>> slopes = fieldkit.estimate([session], model="full")
    >>> fieldkit.compare(slopes, fieldkit.estimate([session], model="full", albedo=0.25)).differences
    {'surface.albedo': ('0.25', '')}
    """
    ours, theirs = _finals(_rows(estimates.columns())), _finals(_other_rows(other))
    moves = [_move(key, ours[key], theirs[key]) for key in ours if key in theirs]
    if not moves:
        raise ConfigError("no region that both estimated", place=str(other), fix="name the same sessions")
    moves.sort(
        key=lambda move: -abs(move.moved_half_widths) if math.isfinite(move.moved_half_widths) else 1.0
    )
    about = earlier_results(Path(other))[0] if isinstance(other, str | Path) else other.about
    names = {move.session for move in moves}
    here, there = _circumstances(estimates.about, names), _circumstances(about, names)
    keys = [key for key in dict.fromkeys((*there, *here)) if here.get(key) != there.get(key)]
    return Comparison(tuple(moves), {key: (there.get(key, ""), here.get(key, "")) for key in keys})


def _rows(columns: Mapping[str, Iterable[Any]]) -> Iterable[dict[str, Any]]:
    return (dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True))


def _other_rows(other: EstimatedSessions | str | Path) -> Iterable[dict[str, Any]]:
    if not isinstance(other, str | Path):
        return _rows(other.columns())
    table = earlier_results(Path(other))[1]
    try:
        with table.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))
    except (OSError, ValueError) as error:
        fix = "estimate the other sessions again, with an output"
        raise ConfigError(f"cannot be read: {message_of(error)}", place=table, fix=fix) from error


def _finals(rows: Iterable[dict[str, Any]]) -> dict[tuple[str, str], dict[str, Any]]:
    """The final row of each region by session and name."""
    rows = list(rows)
    final = final_rows(
        ((row["session"], row["region"]) for row in rows), [row["state"] in _WITH_SLOPE for row in rows]
    )
    return {key: rows[place] for key, place in final.items()}


def _move(key: tuple[str, str], row: Mapping[str, Any], other: Mapping[str, Any]) -> Move:
    tilt, half_width, azimuth = (
        float(row[name] or "nan") for name in ("tilt_deg", "tilt_half_width_deg", "azimuth_deg")
    )
    other_tilt, other_azimuth = (float(other[name] or "nan") for name in ("tilt_deg", "azimuth_deg"))
    turned = (azimuth - other_azimuth + 180.0) % 360.0 - 180.0
    moved = tilt - other_tilt
    share = moved / half_width if half_width else math.nan
    return Move(*key, other_tilt, tilt, moved, share, turned, other["state"], row["state"])


def _circumstances(about: Mapping[str, Any], names: set[str]) -> dict[str, str]:
    """What slopes depend on, by words: settings, code, marks, the content of sessions with these names."""
    compared = [s for s in about["sessions"] if names & {Path(s["path"]).stem, s["path"]}]
    digests = {f"content of {Path(s['path']).stem}": s["sha256"][:12] for s in compared}
    return {
        **dict(setting.split("=", 1) for setting in about["settings"]),
        "campaign": "as it is now" if about["campaign"] else "as recorded",
        "marks without effect": ", ".join(about["without_marks"]),
        "code version": about["code_version"],
        **digests,
    }
