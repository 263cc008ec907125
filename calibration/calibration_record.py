"""A calibration as a file: value, uncertainty, instrument, source sessions; and warnings for its use.

One TOML file each in the campaign's ``calibration/`` folder, named by time and name (``20261210T013000Z-dry-
silica-sand.toml``), never changed afterwards. A configuration names the latest of a name by ``"@dry-silica-
sand"``, or an older one by its whole file name. Celsius in the file, for readers.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import tomlkit
from pydantic import AwareDatetime, Field, TypeAdapter, ValidationError

from fieldkit.calibration.uncertainty import COVERAGE_FACTOR, Contribution
from fieldkit.disk import one_at_a_time, replacing
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError, StorageError, message_of, os_errors_as
from fieldkit.model.next_step import Argument
from fieldkit.model.text_file import parse_toml, read_text

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Spread = Annotated[float, Field(allow_inf_nan=False, ge=0)]
Kind = Literal["emissivity", "uniformity", "irradiance", "surface", "clock"]
SCHEMA = 1
FOLDER = "calibration"
LIFETIME_DAYS: Mapping[str, float] = {
    "emissivity": 365.0, "uniformity": 1.0, "irradiance": 90.0, "surface": 30.0, "clock": 1.0
}  # fmt: skip
"""Default validity of a calibration; a warning follows after that."""
UNKNOWN: Mapping[str, Any] = {"uncertainty": math.nan, "unit": "", "effect": math.nan}
"""Fields that a budget line may lack in a file because they were unknown."""

RANGE_KEYS = ("gain", "range", "range_max_lx")
"""Settings of streams that name the active range."""


@dataclass(frozen=True, slots=True)
class Instrument:
    """The calibrated instrument; `range` is its gain or measuring range."""

    stream: str = ""
    model: str = ""
    serial_number: str = ""
    range: str = ""


@dataclass(frozen=True, slots=True)
class Source:
    """A session from which the calibration was computed, with the SHA-256 of its file."""

    session: str
    sha256: str


@dataclass(frozen=True, slots=True)
class CalibrationRecord:
    """Result of one calibration.

    `value` and `standard_uncertainty` in `unit`; `values` are those of single regions where there are
    several. `degrees_of_freedom` are those of the fit. `details` holds what belongs to the kind alone
    (temperatures, angles, pairs); `settings` the options with which it can be repeated.
    """

    kind: Kind
    name: str
    date: AwareDatetime
    value: _Finite
    standard_uncertainty: _Spread
    unit: str
    method: str
    degrees_of_freedom: float = math.inf
    budget: tuple[Contribution, ...] = ()
    values: Mapping[str, _Finite] = field(default_factory=dict)
    uncertainties: Mapping[str, _Spread] = field(default_factory=dict)
    band: str = ""
    angle_deg: float = math.nan
    instrument: Instrument = field(default_factory=Instrument)
    sources: tuple[Source, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    software: str = ""
    expires: AwareDatetime | None = None

    @property
    def expanded(self) -> float:
        """Expanded uncertainty, k = 2."""
        return COVERAGE_FACTOR * self.standard_uncertainty

    @property
    def file_name(self) -> str:
        """Name of its file in the folder."""
        return f"{self.date.astimezone(UTC):%Y%m%dT%H%M%SZ}-{self.name}.toml"


def expiry(kind: Kind, date: datetime) -> datetime:
    """Age after which a calibration of this kind should be repeated."""
    return date + timedelta(days=LIFETIME_DAYS[kind])


def validity(record: CalibrationRecord) -> str:
    """Surface, temperatures and last day of a record: ``dry (sand, region flat), 5 to 10 °C, until 2027``."""
    surface, span_c = record.details.get("surface"), record.details.get("temperature_range_c")
    parts = (
        f"{record.name} ({surface})" if surface else record.name,
        f"{span_c[0]:.1f} to {span_c[1]:.1f} °C" if span_c else "",
        f"until {record.expires:%Y-%m-%d}" if record.expires else "",
    )
    return ", ".join(filter(None, parts))


def to_toml(record: CalibrationRecord) -> str:
    """The record as TOML text; unknown numbers are omitted."""
    document = as_document(record)
    single = {key: value for key, value in document.items() if not isinstance(value, dict | list)}
    return tomlkit.dumps({**single, **document})  # tables come after all single values


def as_document(record: CalibrationRecord) -> dict[str, Any]:
    """The record as a plain document, as in the file; unknown numbers are omitted."""
    expanded = {"expanded_uncertainty": record.expanded, "coverage_factor": COVERAGE_FACTOR}
    document: dict[str, Any] = _as_json({"schema": SCHEMA, **asdict(record), **expanded})
    return document


def _as_json(value: Any) -> Any:
    """The value without unknown parts: NaN, None, infinity, empty texts and tables; NaN in a list."""
    if isinstance(value, Mapping):
        entries = {str(key): _as_json(item) for key, item in value.items()}
        return {key: item for key, item in entries.items() if item not in (None, "", {}, [])}
    if isinstance(value, list | tuple):
        # nothing is omitted from a list, where the position of a number is its meaning
        return [math.nan if (entry := _as_json(item)) is None else entry for item in value]
    if hasattr(value, "tolist"):  # a numpy number or array
        return _as_json(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def from_toml(text: str, where: str) -> CalibrationRecord:
    """The record in a TOML text; `where` names it in messages. Raises `ConfigError`."""
    return from_document(parse_toml(text, where), where)


def from_document(document: Mapping[str, Any], where: str) -> CalibrationRecord:
    """The record in a parsed document.

    Raises `ConfigError` for a newer layout, and for a key that is absent or has a value that cannot be.
    """
    if document.get("schema") != SCHEMA:
        raise ConfigError(
            f"has layout {document.get('schema')!r}, this fieldkit reads {SCHEMA}",
            place=where,
            fix="calibrate again, or install a newer fieldkit",
        )
    values = {f.name: document[f.name] for f in fields(CalibrationRecord) if f.name in document}
    if isinstance(lines := values.get("budget"), list | tuple):
        values["budget"] = [{**UNKNOWN, **line} if isinstance(line, Mapping) else line for line in lines]
    try:
        # as JSON, whose strict reading takes tables for dataclasses, lists for tuples, but no number for text
        return _form().validate_json(json.dumps(values, default=_as_text), strict=True)
    except ValidationError as error:
        problem = message_of(error)
        fix = f"correct {problem.partition(':')[0]} in it, or calibrate again"
        raise ConfigError(f"not a calibration record: {problem}", place=where, fix=fix) from None


@cache
def _form() -> TypeAdapter[CalibrationRecord]:
    return TypeAdapter(CalibrationRecord)


def _as_text(value: Any) -> str:
    return value.isoformat() if hasattr(value, "isoformat") else str(value)


def save(record: CalibrationRecord, folder: Path) -> Path:
    """Write the record into the folder and return its path.

    An identical record that exists is left as it is. Raises `StorageError` if another one is there, or where
    none can be written.
    """
    path, text = folder / record.file_name, to_toml(record).encode()
    with os_errors_as(
        StorageError, "cannot write", place=path, fix="make room there, or let yourself write there"
    ):
        folder.mkdir(parents=True, exist_ok=True)
        with one_at_a_time(folder):
            if path.exists():
                _require_same(path, text, "sample" if record.kind == "emissivity" else "name")
            else:
                # whole or not at all: a part of a record would be the latest of its name
                with replacing(path) as draft:
                    draft.write_bytes(text)
    return path


def _require_same(path: Path, text: bytes, argument: str) -> None:
    if path.read_bytes() != text:
        raise StorageError(
            "a record is never changed", place=path, fix="give the calibration another " + Argument(argument)
        )


def find(reference: str, folder: Path, kind: str | None = None) -> tuple[CalibrationRecord, Path]:
    """The latest record named `reference`, or the one with that file name, both without ``@`` and suffix.

    Of a `kind`, if there is one: what is measured of one sand may have one name. Raises `ConfigError` that
    lists the available names.
    """
    files = sorted(folder.glob("*.toml")) if folder.is_dir() else []
    matches = [file for file in reversed(files) if reference in (file.stem, file.stem.partition("-")[2])]
    records = ((_read(file), file) for file in matches)
    if latest := next(records, None):
        if kind in (None, latest[0].kind):
            return latest
        return next((record for record in records if record[0].kind == kind), latest)
    names = sorted({file.stem.partition("-")[2] for file in files})
    fix = f"name one of these: {', '.join(names)}" if names else "calibrate first: it holds none"
    raise ConfigError(f"no calibration named {reference!r}", place=folder, fix=fix)


def records_of(session: str, folder: Path) -> Iterator[tuple[CalibrationRecord, Path]]:
    """Records in the folder found from a session, by the name of its file; unreadable ones are skipped."""
    for file in sorted(folder.glob("*.toml")):
        with suppress(ConfigError):
            record = _read(file)
            if any(source.session == session for source in record.sources):
                yield record, file


def _read(file: Path) -> CalibrationRecord:
    return from_toml(read_text(file), str(file))


def instrument_of(info: StreamInfo) -> Instrument:
    """The instrument of a stream, as a record names it."""
    chosen = next((str(info.settings[key]) for key in RANGE_KEYS if key in info.settings), "")
    return Instrument(info.name, info.model, info.serial_number, chosen)


def record_warnings(record: CalibrationRecord, streams: Sequence[StreamInfo], now: datetime) -> list[str]:
    """Warnings, one sentence each; empty if the record fits. `now` is aware."""
    return [*expiry_warnings(record, now), *_other_instrument(record, streams)]


def expiry_warnings(record: CalibrationRecord, now: datetime) -> list[str]:
    """Warnings that depend on the date alone."""
    warnings = []
    if record.expires is not None and now > record.expires:
        days = (now - record.date).days
        warnings.append(
            f"{record.name} is {days} days old and was valid until {record.expires:%Y-%m-%d}: calibrate again"
        )
    if now < record.date - timedelta(days=1):  # the same day counts as now
        warnings.append(f"{record.name} was made on {record.date:%Y-%m-%d}, after now: is the clock right?")
    return warnings


def model_warnings(record: CalibrationRecord, model: str, light: str) -> list[str]:
    """Warnings if a scale was found with another surface model or other light than it is used with.

    `light` is the label of the irradiance model.
    """
    made_with, by_light = record.details.get("model", model), record.details.get("irradiance", light)
    if made_with != model:
        difference = f"of the {made_with} model, not of {model}"
    elif by_light != light:
        difference = f"for light by {by_light}, not by {light}"
    else:
        return []
    return [f"{record.name} is the scale {difference}: calibrate surface again"]


def _other_instrument(record: CalibrationRecord, streams: Sequence[StreamInfo]) -> list[str]:
    made_with = record.instrument
    if not made_with.model and not made_with.serial_number:
        return []
    here = [instrument_of(info) for info in streams if info.name == made_with.stream]
    is_of_camera = record.kind in ("emissivity", "uniformity")
    here = here or [
        instrument_of(info)
        for info in streams
        if (info.is_camera if is_of_camera else info.quantity == "illuminance")
    ]
    if not here:
        return [f"{record.name} was made with {_title(made_with)}, which is not connected"]
    previous = here[0]
    if (previous.model, previous.serial_number) != (made_with.model, made_with.serial_number):
        return [f"{record.name} was made with {_title(made_with)}; here is {_title(previous)}"]
    if previous.range != made_with.range:
        here_range, then = previous.range or "unknown", made_with.range or "unknown"
        return [f"{record.name} was made in range {then}; here is {here_range}"]
    return []


def _title(instrument: Instrument) -> str:
    serial = f" serial {instrument.serial_number}" if instrument.serial_number else ""
    return f"{instrument.model or 'an unnamed instrument'}{serial}"
