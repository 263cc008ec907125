"""Write the generated parts of the reference pages: ``python docs/generate.py``.

Tests compare them. A generated part stands between two comments, ``<!-- generated -->`` and ``<!-- end -->``.
"""

from __future__ import annotations

import inspect
import io
import json
from pathlib import Path
from typing import Any

import click
import h5py

from fieldkit.cli import main
from fieldkit.cli.common import CommandGroup, Options
from fieldkit.config import toml_schema
from fieldkit.model.alarm import Condition
from fieldkit.model.device import StreamInfo
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SLOPE_FIELDS
from fieldkit.sessions.file_tree import file_image, put_columns, put_group
from fieldkit.sessions.journal import SessionIdentity
from fieldkit.sessions.layout import LATER_EVENT_COLUMNS, LATER_EVENTS, SessionHeader

REFERENCE = Path(__file__).parent / "reference"
BEGIN, END = "<!-- generated -->\n", "<!-- end -->"


def configuration() -> str:
    """A table of keys for each table of ``fieldkit.toml``."""
    parts = []
    headings = [_heading(name) for name in toml_schema.known_keys(()) if name != "schema"]
    headings.insert(1 + headings.index(_heading("camera")), ("[camera.pose]", ("camera", "pose")))
    for heading, path in headings:
        node = toml_schema.node_at(path) or {}
        rows = [_key_row(key, toml_schema.resolve(field)) for key, field in node["properties"].items()]
        about = node["description"]
        head = ["| key | takes | default | meaning |", "|---|---|---|---|"]
        parts.append("\n".join([f"### `{heading}`", "", about, "", *head, *rows]))
    return "\n\n".join(parts) + "\n"


def command_line() -> str:
    """Usage, purpose and own options of every command."""
    context = main.make_context("fieldkit", ["--help"], resilient_parsing=True)
    parts = []
    for heading, summaries in main.table.items():
        parts.append(f"## {heading}")
        for word in summaries:
            command = main.get_command(context, word)
            assert command is not None
            named = command.commands.items() if isinstance(command, CommandGroup) else [("", command)]
            parts.extend(_command(f"{word} {name}".strip(), one) for name, one in named)
    return "\n\n".join(parts) + "\n"


def session_file() -> str:
    """Everything that a session file can have: of each group its attributes and a table of its datasets."""
    row = ((0.0, 0.0),) * 3
    header = SessionHeader(
        "", Site(0.0, 0.0), (
            StreamInfo("camera", "brightness_temperature", "K", (8, 10), 0.01, metadata_shape=(1, 10)),
            StreamInfo("lux", "illuminance", "lx", (1,)),
            StreamInfo("thermometer", "temperature", "K", (2,), channels=("T1", "T2")),
        ), (Region("flat", RegionKind.REFERENCE, row),),
    )  # fmt: skip
    image = io.BytesIO(file_image(SessionIdentity("", 0, 0, header)))
    with h5py.File(image, "r+") as file:
        put_columns(put_group(file, LATER_EVENTS, "NXlog"), LATER_EVENT_COLUMNS)
        groups = [file, *(node for node in _nodes(file) if isinstance(node, h5py.Group))]
        return "\n".join([_slopes(), *map(_group, groups)])


def _nodes(file: h5py.File) -> list[h5py.Group | h5py.Dataset]:
    nodes: list[h5py.Group | h5py.Dataset] = []
    file.visititems(lambda _, node: nodes.append(node))
    return nodes


def _group(group: h5py.Group) -> str:
    head = [
        f"### `{group.name}`",
        "",
        f"Attributes: {', '.join(f'`{name}`' for name in sorted(group.attrs))}.",
        "",
    ]
    datasets = [node for node in group.values() if isinstance(node, h5py.Dataset)]
    table = ["| dataset | type | axes | unit | meaning | further attributes |", "|---|---|---|---|---|---|"]
    return "\n".join([*head, *(table if datasets else ()), *map(_dataset, datasets), ""])


_SAID = {"units", "long_name", "flag_values", "flag_masks", "flag_meanings", "NX_class"}
_OF_LIBRARIES = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"}


def _dataset(node: h5py.Dataset) -> str:
    about = {name: _text(value) for name, value in node.attrs.items() if name not in _OF_LIBRARIES}
    values = node.attrs.get("flag_values", node.attrs.get("flag_masks", ()))
    meanings = zip(values, about.get("flag_meanings", "").split(), strict=True)
    meaning = ", ".join([about.get("long_name", ""), *(f"{value} {word}" for value, word in meanings)])
    kind = f"text, {node.dtype.itemsize} bytes" if node.dtype.kind == "S" else str(node.dtype)
    if kind.startswith("text") and node.shape == ():
        kind = "text"
    axes = " ".join(dim[0].name.rsplit("/", 1)[1] for dim in node.dims if len(dim)) or "–"
    more = ", ".join(f"`{name}`" for name in sorted(set(about) - _SAID))
    cells = (
        f"`{node.name.rsplit('/', 1)[1]}`",
        kind,
        axes,
        about.get("units", ""),
        meaning.strip(", "),
        more,
    )
    return f"| {' | '.join(cells)} |"


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _slopes() -> str:
    """A table of the numbers of a slope, which every table and file has."""
    head = ["| number | unit | exported table | meaning |", "|---|---|---|---|"]
    rows = [
        f"| `{field.key}` | {field.unit} | {field.heading} | {field.description} |"
        for field in SLOPE_FIELDS.values()
    ]
    return "\n".join([*head, *rows]) + "\n"


def alarms() -> str:
    """A table of the conditions that raise an alarm."""
    head = ["| condition | raised when | severity | lasts at least | over for |", "|---|---|---|---|---|"]
    rows = [
        f"| `{one}` | {one.meaning} | {one.rule.severity.name.lower()} | {_lasting(one.rule.hold_s)} "
        f"| {_lasting(one.rule.clear_s)} |"
        for one in Condition
    ]
    return "\n".join([*head, *rows]) + "\n"


def _lasting(seconds: float) -> str:
    if not seconds:
        return "–"
    return f"{seconds:g} s" if seconds < 60 else f"{seconds / 60:g} min"


def refreshed(page: Path, text: str) -> str:
    """The page with its generated part replaced."""
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    return f"{before}{BEGIN}\n{text}\n{END}{rest.partition(END)[2]}"


PAGES = {
    REFERENCE / "configuration.md": configuration,
    REFERENCE / "command-line.md": command_line,
    REFERENCE / "session-file.md": session_file,
    REFERENCE.parent / "how-to/alarms.md": alarms,
}


def _heading(name: str) -> tuple[str, tuple[str | int, ...]]:
    if name == "region":
        return "[[region]]", (name, 0)
    if name in ("device", "trigger"):
        return f"[{name}.NAME]", (name, "NAME")
    return f"[{name}]", (name,)


def _key_row(key: str, node: dict[str, Any]) -> str:
    default = node.get("default")
    shown = "" if default is None else f"`{json.dumps(default)}`"
    return f"| `{key}` | {toml_schema.kind(node)} | {shown} | {node['description']} |"


def _command(name: str, command: click.Command) -> str:
    context = click.Context(command, info_name=f"fieldkit {name}")
    common = {*Options.__dataclass_fields__, "help"}
    own = [parameter for parameter in command.params if parameter.name not in common]
    usage = [piece for piece in command.collect_usage_pieces(context) if piece != "[OPTIONS]"]
    parts = [f"### `{' '.join(['fieldkit', name, *usage])}`", *_paragraphs(command.help or "")]
    records = [record for parameter in own if (record := parameter.get_help_record(context)) and record[1]]
    if records:
        parts.append(
            "\n".join(
                [
                    "| option | meaning |",
                    "|---|---|",
                    *(f"| `{left}` | {_cell(right)} |" for left, right in records),
                ]
            )
        )
    return "\n\n".join(parts)


def _paragraphs(text: str) -> list[str]:
    """The help's paragraphs; examples, which click keeps line by line after a backspace, as code."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return [
        "```\n" + paragraph.removeprefix("\b\n").strip() + "\n```"
        if paragraph.startswith("\b")
        else paragraph.strip()
        for paragraph in paragraphs
    ]


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


if __name__ == "__main__":
    for page, make in PAGES.items():
        page.write_text(refreshed(page, make()), encoding="utf-8")
