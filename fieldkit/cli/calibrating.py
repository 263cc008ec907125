"""What the verbs of ``fieldkit calibrate`` share: the session, where records go, how a result is told."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

import fieldkit
from fieldkit.calibration.calibration_record import CalibrationRecord, Source, as_document, expiry, save
from fieldkit.calibration.uncertainty import Contribution, combined_uncertainty, largest
from fieldkit.cli import common
from fieldkit.config import Config
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.site import Region
from fieldkit.sessions.reader import Session

WIDEST_BAR = 24


def moment(session: Session) -> datetime:
    """When the session ended: the date of what is worked out from it."""
    return datetime.fromtimestamp(session.end_ns // 10**9, UTC)


def source_of(path: Path) -> Source:
    """A session as a record names it."""
    with path.open("rb") as file:
        return Source(path.name, hashlib.file_digest(file, "sha256").hexdigest())


def one_region(regions: Sequence[Region], name: str, path: Path) -> Region:
    """The region of that name; raises `ConfigError` naming what there is."""
    for region in regions:
        if region.name == name:
            return region
    have = ", ".join(region.name for region in regions) or "none"
    raise ConfigError(f"{path} has no region {name!r}", fix=f"it has {have}; fieldkit roi add draws one")


def one_stream(session: Session, quantity: str, name: str | None = None) -> StreamInfo:
    """The only stream of a quantity, or the one named; raises `ConfigError` naming what there is."""
    found = [info for info in session.streams.values() if info.quantity == quantity]
    chosen = [info for info in found if name in (None, info.name)]
    if len(chosen) == 1:
        return chosen[0]
    have = ", ".join(info.name for info in found) or "none"
    which = f"no {quantity} stream {name!r}" if name else f"which {quantity} stream?"
    raise ConfigError(f"{session.path}: {which}", fix=f"it has {have}")


def finish(record: CalibrationRecord, config: Config, headline: str, used_by: str) -> Path:
    """Save the record, tell value and budget; the path."""
    record = replace(
        record, software=f"fieldkit {fieldkit.__version__}", expires=expiry(record.kind, record.date)
    )
    path = save(record, config.calibration)
    if common.options().json:
        common.print_json({"record": str(path), **as_document(record)})
        return path
    click.echo(headline)
    if record.budget:
        print_budget(record.budget, record.unit)
    for remark in record.remarks:
        click.echo(f"note: {remark}")
    common.say(f"saved {path}     used by: {used_by}")
    return path


def print_budget(budget: Sequence[Contribution], unit: str) -> None:
    """The budget as a table with bars; the largest contribution is named."""
    worst = max(abs(line.effect) for line in budget) or 1.0
    rows: list[tuple[str, ...]] = [
        (
            line.name,
            f"{line.uncertainty:.3g} {'' if line.unit == '1' else line.unit}".strip(),
            line.kind,
            f"{abs(line.effect):.2g}",
            "█" * round(WIDEST_BAR * abs(line.effect) / worst),
        )
        for line in budget
    ]
    rows.append(("combined (k=1)", "", "", f"{combined_uncertainty(budget):.2g}", ""))
    common.print_table(("contribution", "uncertainty", "type", f"effect{_in(unit)}", ""), rows)
    click.echo(f"largest contribution: {largest(budget).name}")


def _in(unit: str) -> str:
    return "" if unit == "1" else f" [{unit}]"


def told_settings(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a verb as a record keeps them, to work the value out again."""
    return {
        key: str(value) if isinstance(value, Path) else list(value) if isinstance(value, tuple) else value
        for key, value in options.items()
        if value not in (None, (), "", False)
    }
