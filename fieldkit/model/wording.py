"""What to do next, in the words of the place where it is read: commands and options, or calls and arguments.

Messages are written for the command line. Read in Python, each command becomes the call that does the same,
each option the argument; a command without one is left as it is, to be typed in a terminal.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

CALLS = {
    "calibrate": "fieldkit.calibrate",
    "calibrate clock": "fieldkit.calibrate.clock({})",
    "calibrate emissivity": "fieldkit.calibrate.emissivity({}, sample=...)",
    "calibrate irradiance": "fieldkit.calibrate.irradiance({}, against=..., reference=...)",
    "calibrate surface": "fieldkit.calibrate.surface({})",
    "calibrate uniformity": "fieldkit.calibrate.uniformity({})",
    "check": "fieldkit.check({})",
    "devices --add": "campaign.add_devices()",
    "devices": "fieldkit.find_devices()",
    "doctor": "fieldkit.doctor()",
    "estimate": "fieldkit.estimate({})",
    "export": "fieldkit.export({})",
    "import": "fieldkit.import_recording",
    "init --simulated": "fieldkit.init_campaign({}, simulated=True)",
    "init": "fieldkit.init_campaign({})",
    "ls": "fieldkit.open_campaign().sessions",
    "mark": "fieldkit.mark(text)",
    "record": "fieldkit.record()",
    "recover": "fieldkit.sessions.recovery.recover({})",
    "report": "fieldkit.report({})",
    "roi add": "campaign.add_region(name, points=[...])",
    "show": "print(session)",
    "status": "fieldkit.status()",
    "stop": "fieldkit.stop()",
}
"""The call that does what a command does; ``{}`` is a session, or the file named behind the command."""

_NAMED_ALIKE = (
    "camera_emissivity", "cell_m", "channel", "drive_deg", "encoding", "every", "gps", "ground_m",
    "hfov_deg", "keep", "kelvin_at_zero", "kelvin_per_count", "limit_deg", "mark_sd_px", "measures", "name",
    "out", "palette", "pose", "reflected", "region", "sample", "session", "site", "speed", "stream", "tape",
    "thermometer", "time_format", "times", "title", "to", "unit", "until", "window", "zone",
)  # fmt: skip
"""Arguments that have the names of their options."""
ARGUMENTS = {
    **{f"--{name.replace('_', '-')}": name for name in _NAMED_ALIKE},
    "--as": "name", "--campaign": "present=True", "--clock-offset": "offset_s", "--column": "columns",
    "--facet": "facets", "--for": "duration", "--from": "begin", "--time": "time_columns", "-j": "jobs",
}  # fmt: skip
"""The argument that is what an option is."""

PHRASES = {
    "fieldkit mark --at": "fieldkit.mark(text, at=...)",
    "fieldkit report SESSION --campaign": "fieldkit.report(session, options=ReportOptions(present=True))",
    "fieldkit estimate -o BASE": "fieldkit.estimate(session)",
    "export --to csv": 'fieldkit.export(session, "csv")',
    "export --to png": 'fieldkit.export(session, "png")',
    "--kelvin-per-count none": "kelvin_per_count=math.nan",
    "with fieldkit roi": "with campaign.add_region(name, points=[...])",
    "a smaller --shrink": "a smaller shrink_px",
    "name it with -C DIR": "name it",
    "with -C DIR": "for the campaign",
    "--set on the command line": "the settings",
    "the settings given with --set": "the settings",
    "(-j)": "(jobs)",
    " with -o": "",
    "-o DIR": "folder",
    "-o FILE.html": "out",
    " -o ": " ",
    "--into SESSION": "fieldkit.import_into(session, source)",
    "of --into": "of fieldkit.import_into()",
    "--site LAT,LON,ALT": "site=fieldkit.Site(...)",
    "--facet TILT,AZIMUTH": "facets=[(tilt, azimuth)]",
    "compare with a phone: --at": "compare with a phone: fieldkit.calibrate.host_clock(...)",
    "read another clock with --at": "read another clock: fieldkit.calibrate.host_clock(...)",
}
"""What is neither a command nor an option and its value."""

_NAMES = ("NAME",)
_SHELL = re.compile(r"sudo |\| sudo|systemctl|pip install|gdalwarp|rio edit-info|modprobe|journalctl|--help")
_NO_VALUES = r"(?:(?:has|is|are|of|or|and|to|with|if|in|alone|would|does|needs|moves|again|that|the)\b|--)"
_VALUE = rf"(?:[ =](?!{_NO_VALUES})(\"[^\"]*\"|'[^']*'|@?[\w+.:/{{-]*[\w}}/]))?"
_OPTION = re.compile(rf"(?<![\w-])(--[a-z][a-z-]*|-j){_VALUE}")
_SET = re.compile(r"(?<![\w-])--set(?: ([\w.]+)=([\w.:@-]*[\w-]))?")
_STATED = re.compile(r"\bfieldkit devices --add --instrument ([^=\s]+)=(?:([\w-]+),)?(\w+)(?:=(\w+))?")
_FILE = r"DIR|SESSION|'[^']+'|[^\s:]*[./][^\s;,]*\w"
_NAMED = "|".join(sorted(CALLS, key=len, reverse=True))
_COMMAND = re.compile(rf"\bfieldkit ({_NAMED})\b(?! --)(?: ({_FILE}))?")
_LEFT = re.compile(r"\bfieldkit (?:roi|decode|check|doctor|page|service)\b(?!.*\(in a terminal\))")
_is_typed = False


@contextmanager
def typed() -> Iterator[None]:
    """Word everything for the command line meanwhile: a process has one reader, as it has one locale."""
    global _is_typed  # noqa: PLW0603
    before, _is_typed = _is_typed, True
    try:
        yield
    finally:
        _is_typed = before


def worded(text: str) -> str:
    """A text that names commands and options, in the words of the place where it is read."""
    return text if _is_typed else in_python(text)


def in_python(text: str) -> str:
    """A text with calls and arguments in place of commands and options; what is for a shell stays."""
    if _SHELL.search(text):
        return text
    for phrase, python in PHRASES.items():
        text = text.replace(phrase, python)
    text = _COMMAND.sub(_call, _STATED.sub(_stated, text))
    text = _OPTION.sub(_argument, _SET.sub(_setting, text))
    return f"{text} (in a terminal)" if _LEFT.search(text) else text


def _call(found: re.Match[str]) -> str:
    command, file = found.groups()
    if not file or file.isupper():
        file = "folder" if command.startswith("init") else "session"
    else:
        file = f'"{file.strip(chr(39))}"'
    return CALLS[command].format(file)


def _stated(found: re.Match[str]) -> str:
    identity, driver, key, value = found.groups()
    options = f'"driver": "{driver}", "{key}": {value}' if driver else f'"driver": {key}'
    return f'campaign.add_devices({{"{identity}": {{{options}}}}})'


def _setting(found: re.Match[str]) -> str:
    key, value = found.groups()
    return f'settings={{"{key}": {_literal(value)}}}' if key else "settings"


def _argument(found: re.Match[str]) -> str:
    option, value = found.groups()
    if option not in ARGUMENTS:
        return found[0]
    return f"{ARGUMENTS[option]}={_literal(value)}" if value else ARGUMENTS[option]


def _literal(value: str) -> str:
    """A value as Python writes it: a number, what is quoted already, or text; a name for one stays a name."""
    if value[0] in "\"'{" or value in _NAMES:
        return value
    number = value.lstrip("+").removesuffix("s")
    return number if re.fullmatch(r"-?\d+(\.\d+)?", number) else f'"{value}"'
