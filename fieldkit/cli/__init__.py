"""The command line: ``fieldkit COMMAND``, one module per command, imported only when it runs.

A module exports `command`, made with ``cls=Command`` (or ``cls=CommandGroup``) of `fieldkit.cli.common`: it
parses options, calls a function, and prints what that returned. The summaries stand here, so that
``fieldkit --help`` imports no command and none of the heavy libraries.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

import click

from fieldkit.cli.failure import explain_failures
from fieldkit.model.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.shell_completion import CompletionItem


PLACES = {
    "import": ("import_session", "command"),  # a word of Python
    **{name: ("running", name) for name in ("status", "stop", "shutter")},
}
"""Module and name of commands that are not ``command`` in a module of their own name."""

COMMANDS: dict[str, dict[str, str]] = {
    "Start": {
        "demo": "Run the whole experiment on simulated devices, then report.",
        "init": "Create a campaign: a short fieldkit.toml and folders.",
        "doctor": "Check that this computer is ready; every problem has a fix.",
        "devices": "List connected instruments and the identity to configure.",
    },
    "Plan": {
        "plan": "Show a day's best hours, sensitivity and possible accuracy.",
        "sun": "Compute sun and incidence angles for places, times, facets.",
    },
    "Set up": {
        "live": "Show the current frame and readings without recording.",
        "roi": "Add, list, check, edit or remove regions of the image.",
        "calibrate": "Calibrate emissivity, offsets, irradiance, surface, clock.",
    },
    "Record": {
        "record": "Record a session; Ctrl-C stops and seals it.",
        "status": "Show how the running recording is doing.",
        "stop": "Stop and seal the running recording.",
        "mark": "Add a note to the running recording.",
        "page": "Serve the field page: see, draw, start, mark in a browser.",
        "service": "Run the page, and a recording, from boot on (systemd).",
        "shutter": "Run the camera's shutter correction now.",
    },
    "Afterwards": {
        "ls": "List the sessions of a campaign.",
        "show": "Summarise one session; --follow while it is recorded.",
        "check": "Check that a session is complete and plausible.",
        "recover": "Finish a session whose recording was interrupted.",
        "replay": "Play a session as if live.",
        "import": "Make a session of a recording by other software.",
    },
    "Work": {
        "estimate": "Estimate slopes of recorded sessions.",
        "sweep": "Estimate sessions with many sets of parameters.",
        "map": "Map tilt and azimuth of every pixel: image and arrays.",
        "report": "Write a session's report: one page with figures.",
        "export": "Export a session as CSV, Parquet, netCDF, images or video.",
        "study": "Reproduce the paper's simulation study: tables and figures.",
    },
    "Tool": {
        "decode": "Decode bytes of an instrument.",
        "selftest": "Check that a driver meets the driver contract.",
    },
}
"""Every command with its line in ``fieldkit --help``, by heading."""


COMMON = ("-C", "--json", "-q", "--quiet", "-v", "--verbose", "--no-color", "--no-input")
"""Options that every command takes (`fieldkit.cli.common`)."""


class CommandTable(click.Group):
    """A click group whose commands come from a table and are imported when they run."""

    def __init__(self, table: dict[str, dict[str, str]], **settings: Any) -> None:
        super().__init__(**settings)
        self.table = table
        self.summaries: dict[str, str] = {
            name: text for of_one in table.values() for name, text in of_one.items()
        }

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every command, in the order of the table."""
        return list(self.summaries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name, or None."""
        if cmd_name not in self.summaries:
            return None
        module, name = PLACES.get(cmd_name, (cmd_name, "command"))
        command = getattr(importlib.import_module(f"{__name__}.{module}"), name)
        assert isinstance(command, click.Command)
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the options before the command; common options belong after it, as the error says."""
        try:
            return super().parse_args(ctx, list(args))
        except click.NoSuchOption as error:
            name = next((word for word in args if word in self.summaries), "COMMAND")
            if error.option_name not in COMMON:
                raise
            raise click.UsageError(
                f"{error.option_name} goes after the command: fieldkit {name} {error.option_name} ...", ctx
            ) from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that was typed; for a misspelled one, name the nearest."""
        if args[0] not in self.summaries and not args[0].startswith("-"):
            raise click.UsageError(f"there is no command {args[0]!r}{self._nearest(args[0])}", ctx)
        return super().resolve_command(ctx, args)

    def _nearest(self, typed: str) -> str:
        from fieldkit.model.spelling import nearest

        near = nearest(typed, self.summaries)
        return f"; did you mean {near!r}?" if near else ""

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Completions of a word typed in a shell: commands with their summaries, without importing any."""
        from click.shell_completion import CompletionItem

        names = (name for name in self.summaries if name.startswith(incomplete))
        commands = [CompletionItem(name, help=self.summaries[name]) for name in names]
        return [*commands, *click.Command.shell_complete(self, ctx, incomplete)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings, without importing any."""
        width = max(len(name) for name in self.summaries)
        for heading, summaries in self.table.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), text) for name, text in summaries.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a failure is explained on stderr and gives its exit code."""
        # read when numpy is imported; threads lose with matrices of 60 x 60: a third of the time of a map
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        with explain_failures(ctx):
            return super().invoke(ctx)


CITATION = """\
The program: The fieldkit developers, "fieldkit: terrain slope from surface temperature", version {version}.

The method: Satoshi Watanabe, Kyohei Otsu, Masatsugu Otsuki, Takashi Kubota, Gakuto Masuyama, Kazunori Umeda,
"A Terrain Slope Estimation Scheme using Infrared Camera for Planetary Exploration Rovers".

With every slope: which session, which method, and its uncertainty; fieldkit report prints all three."""


def _citation() -> str:
    return CITATION.format(version=__version__)


def _version() -> str:
    from fieldkit.model.installation import origin

    return f"fieldkit {__version__} ({origin()})"


def _printing(
    name: str, text: Callable[[], str], help: str
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """An option that prints a text and ends."""

    def print_and_end(ctx: click.Context, _option: click.Parameter, is_wanted: bool) -> None:
        if is_wanted and not ctx.resilient_parsing:
            click.echo(text())
            ctx.exit()

    return click.option(
        name, is_flag=True, is_eager=True, expose_value=False, callback=print_and_end, help=help
    )


@click.group(
    cls=CommandTable,
    table=COMMANDS,
    subcommand_metavar="COMMAND [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@_printing("--version", _version, "Version, commit, and where it came from.")
@_printing("--cite", _citation, "What to cite in a publication.")
def main() -> None:
    """Terrain slope from surface temperature: record, estimate, report.

    First time here: fieldkit demo
    """
