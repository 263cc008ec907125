"""``fieldkit decode``: decode bytes by a driver, without an instrument."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.common import Command, print_if_json, print_table
from fieldkit.cli.types import KEY_VALUE
from fieldkit.model.errors import ConfigError
from fieldkit.model.units import CELSIUS_ZERO_K

if TYPE_CHECKING:
    from fieldkit.drivers.decoding import Decoded, Value

TEXT_DRIVERS = ("nmea", "gpsd", "text")
"""Drivers whose records are text, which can be typed as it is."""

_SEPARATORS = re.compile(r"0x|[\s,:;-]", re.IGNORECASE)
_MAX_ROWS = 200


@click.command(cls=Command)
@click.argument("driver")
@click.argument("data", nargs=-1, required=True, metavar="HEX...|FILE|-")
@click.option(
    "--option", "pairs", type=KEY_VALUE, multiple=True, help="An option of the driver, such as map of modbus."
)
def command(driver: str, data: tuple[str, ...], pairs: tuple[tuple[str, Any], ...]) -> None:
    r"""Decode bytes of an instrument: values, flags, or why they are rejected.

    The bytes come as hexadecimal, in a file, or on standard input (-).

    \b
    fieldkit decode lutron 02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D
    fieldkit decode modbus --option map=kipp-smp "01 04 10 ..."
    fieldkit decode purethermal frame.raw --json
    """
    from fieldkit.drivers import registry

    decoded = registry.decode(driver, read_bytes(data, is_text=driver in TEXT_DRIVERS), dict(pairs))
    if not print_if_json(as_document(decoded)):
        _print(decoded)


def read_bytes(words: Sequence[str], *, is_text: bool = False) -> bytes:
    """The bytes of a file, of standard input, of hexadecimal, or with `is_text` the text itself.

    Raises `ConfigError` for words that are none of these.
    """
    if list(words) == ["-"]:
        return sys.stdin.buffer.read()
    if len(words) == 1 and _is_file(words[0]):
        return Path(words[0]).read_bytes()
    text = " ".join(words)
    digits = _SEPARATORS.sub("", text)
    if re.fullmatch(r"([0-9a-fA-F]{2})+", digits):
        return bytes.fromhex(digits)
    if is_text:
        return text.replace("\\r", "\r").replace("\\n", "\n").rstrip("\n").encode() + b"\n"  # typed: a line
    raise ConfigError(
        "is neither a file nor hexadecimal",
        place=repr(text[:60]),
        fix="write two digits per byte, as in: 02 34 31",
    )


def _is_file(word: str) -> bool:
    """True if a word names a file; hexadecimal may be longer than the longest file name."""
    try:
        return Path(word).is_file()
    except (OSError, ValueError):
        return False


def as_document(decoded: Decoded) -> dict[str, Any]:
    """The JSON form: readings, what was rejected and why, bytes left over, notes."""
    from fieldkit.results.json_document import attributes

    readings = [attributes(value, "value", "unit", "channel", "flags") for value in decoded.values]
    rejected = [attributes(part, "offset", "length", "reason") for part in decoded.rejected]
    return {"readings": readings, "rejected": rejected, "rest": decoded.rest, "notes": list(decoded.notes)}


def _print(decoded: Decoded) -> None:
    rows = [
        [value.channel, _value_text(value), ", ".join(value.flags)] for value in decoded.values[:_MAX_ROWS]
    ]
    if rows:
        print_table(["channel", "value", "flags"], rows)
    if len(decoded.values) > _MAX_ROWS:
        click.echo(f"... and {len(decoded.values) - _MAX_ROWS} more values; --json prints all")
    for note in decoded.notes[:_MAX_ROWS]:
        click.echo(note)
    for part in decoded.rejected[:_MAX_ROWS]:
        click.echo(f"rejected at byte {part.offset}, {part.length} bytes: {part.reason}")
    if decoded.rest:
        click.echo(f"{decoded.rest} bytes left over")
    if not (rows or decoded.notes or decoded.rejected or decoded.rest):
        click.echo("no bytes")


def _value_text(value: Value) -> str:
    if value.value != value.value:
        return "no value"
    celsius = f" ({value.value - CELSIUS_ZERO_K:.2f} °C)" if value.unit == "K" else ""
    return f"{value.value:.8g} {value.unit}{celsius}".strip()
