"""What speaks against using a record here and now: its age, another instrument, another range."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

from fieldkit.calibration.record import CalibrationRecord, Instrument
from fieldkit.model.device import StreamInfo

RANGE_KEYS = ("gain", "range", "range_max_lx")
"""Where streams say which of their ranges is in use."""


def instrument_of(info: StreamInfo) -> Instrument:
    """An instrument as a record names it."""
    chosen = next((str(info.settings[key]) for key in RANGE_KEYS if key in info.settings), "")
    return Instrument(info.name, info.model, info.serial_number, chosen)


def doubts(record: CalibrationRecord, streams: Sequence[StreamInfo], now: datetime) -> list[str]:
    """Sentences, each a warning; empty if the record fits. `now` is aware."""
    return [*doubts_of_date(record, now), *_other_instrument(record, streams)]


def doubts_of_date(record: CalibrationRecord, now: datetime) -> list[str]:
    """Of them, those that need no instrument."""
    said = []
    if record.expires is not None and now > record.expires:
        days = (now - record.date).days
        said.append(
            f"{record.name} is {days} days old and was good until {record.expires:%Y-%m-%d}: calibrate again"
        )
    if now < record.date - timedelta(days=1):  # the same day counts as now
        said.append(f"{record.name} was made on {record.date:%Y-%m-%d}, after now: is the clock right?")
    return said


def _other_instrument(record: CalibrationRecord, streams: Sequence[StreamInfo]) -> list[str]:
    made_with = record.instrument
    if not made_with.model and not made_with.serial_number:
        return []
    here = [instrument_of(info) for info in streams if info.name == made_with.stream]
    here = here or [instrument_of(info) for info in streams if info.is_camera]
    if not here:
        return [f"{record.name} was made with {_title(made_with)}, which is not here"]
    found = here[0]
    if (found.model, found.serial_number) != (made_with.model, made_with.serial_number):
        return [f"{record.name} was made with {_title(made_with)}; here is {_title(found)}"]
    if found.range != made_with.range:
        here_range, then = found.range or "unknown", made_with.range or "unknown"
        return [f"{record.name} was made in range {then}; here is {here_range}"]
    return []


def _title(instrument: Instrument) -> str:
    serial = f" serial {instrument.serial_number}" if instrument.serial_number else ""
    return f"{instrument.model or 'an unnamed instrument'}{serial}"
