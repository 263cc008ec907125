"""The man pages of fieldkit and of each command, made from the commands when a package is built."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import click

from fieldkit.cli import main
from fieldkit.cli.common import Command, CommandGroup, Options
from fieldkit.model.version import __version__

ROOT = Path(__file__).parents[1]
MANUAL = "fieldkit manual"


def man_pages() -> dict[str, str]:
    """The pages in man(7)'s macros, by file name."""
    pages = {f"fieldkit-{name}.1": _page(name, summary) for name, summary in main.summaries.items()}
    return {"fieldkit.1": _page_of_all(), **pages}


def _page_of_all() -> str:
    context = _context()
    purpose, *more = (main.help or "").split("\n\n")
    lines = [*_head("fieldkit", purpose), ".SH SYNOPSIS", *_usage("fieldkit", main)]
    lines += [".SH DESCRIPTION", *_paragraphs(more)]
    lines += _options(context, main.params)
    for heading, summaries in main.table.items():
        lines.append(f".SH {_escaped(heading.upper())}")
        for name, summary in summaries.items():
            lines += [".TP", rf"\fBfieldkit\-{_escaped(name)}\fR(1)", _line(summary)]
    common = [parameter for parameter in Command("any").params if parameter.name in _COMMON]
    lines += _options(context, common, "OPTIONS OF EVERY COMMAND")
    lines.append(".SH EXIT STATUS")
    for code, meaning in _exit_codes():
        lines += [".TP", rf"\fB{code}\fR", _line(meaning)]
    return _text(lines)


def _page(command_name: str, summary: str) -> str:
    name, context = f"fieldkit {command_name}", _context()
    command = main.get_command(context, command_name)
    assert command is not None
    lines = [*_head(name.replace(" ", "-"), summary)]
    if isinstance(command, CommandGroup):
        lines += [".SH DESCRIPTION", *_help(command)]
        for word, one in command.commands.items():
            lines += [f".SH {_escaped(f'{name} {word}'.upper())}", *_usage(f"{name} {word}", one), ".PP"]
            lines += [*_help(one), *_options(_context(one), _own(one), "")]
    else:
        lines += [".SH SYNOPSIS", *_usage(name, command), ".SH DESCRIPTION", *_help(command)]
        lines += _options(_context(command), _own(command))
    lines += [".SH SEE ALSO", r"\fBfieldkit\fR(1): options of every command, exit status"]
    return _text(lines)


_COMMON = {*Options.__dataclass_fields__, "help"}


def _own(command: click.Command) -> list[click.Parameter]:
    return [parameter for parameter in command.params if parameter.name not in _COMMON]


def _context(command: click.Command = main) -> click.Context:
    return click.Context(command, info_name="fieldkit")


def _head(name: str, purpose: str) -> Iterator[str]:
    yield f'.TH {_escaped(name.upper())} 1 {_release_date()} "fieldkit {__version__}" "{MANUAL}"'
    yield ".SH NAME"
    yield rf"{_escaped(name)} \- {_escaped(' '.join(purpose.split()).rstrip('.'))}"


def _usage(name: str, command: click.Command) -> Iterator[str]:
    pieces = " ".join(command.collect_usage_pieces(_context(command)))
    yield rf"\fB{_escaped(name)}\fR {_escaped(pieces)}"


def _help(command: click.Command) -> Iterator[str]:
    return _paragraphs(inspect.cleandoc(command.help or "").split("\n\n"))


def _paragraphs(texts: Sequence[str]) -> Iterator[str]:
    """Paragraphs; one that click keeps line by line, after a backspace, is an example."""
    for number, text in enumerate(texts):
        if number:
            yield ".PP"
        if text.startswith("\b"):
            yield from (
                ".EX",
                *(_line(line) for line in text.removeprefix("\b\n").strip().split("\n")),
                ".EE",
            )
        else:
            yield _line(" ".join(text.split()))


def _options(
    context: click.Context, parameters: Sequence[click.Parameter], heading: str = "OPTIONS"
) -> Iterator[str]:
    records = [
        record for parameter in parameters if (record := parameter.get_help_record(context)) and record[1]
    ]
    if records and heading:
        yield f".SH {heading}"
    for names, meaning in records:
        yield from (".TP", rf"\fB{_escaped(names)}\fR", _line(" ".join(meaning.split())))


def _exit_codes() -> list[tuple[str, str]]:
    """The table of the reference page, which people look into as well."""
    page = (ROOT / "docs/reference/command-line.md").read_text(encoding="utf-8")
    return re.findall(r"(?m)^\| (\d+) \| (.+) \|$", page)


def _release_date() -> str:
    """When this version was released, by the changelog."""
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    found = re.search(rf"(?m)^## {re.escape(__version__)} \((\S+)\)", changelog)
    assert found, f"the changelog has no date of {__version__}"
    return found[1]


def _line(text: str) -> str:
    """A line of text; a dot or an apostrophe in front would make it a request."""
    return rf"\&{_escaped(text)}" if text.startswith((".", "'")) else _escaped(text)


def _escaped(text: str) -> str:
    return text.replace("\\", r"\e").replace("-", r"\-").replace("`", "")


def _text(lines: Sequence[str]) -> str:
    return "\n".join(line.rstrip() for line in lines) + "\n"
