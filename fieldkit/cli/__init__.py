"""The command line: ``fieldkit COMMAND``, one module per command, imported only when it runs.

A module exports `command`, made with ``cls=Command`` (or ``cls=CommandGroup``) of `fieldkit.cli.common`: it
parses options, calls a function, and prints what that returned. The summaries stand here, so that
``fieldkit --help`` imports no command and none of the heavy libraries.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from fieldkit import __version__
from fieldkit.cli.failure import explain_failures

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


class CommandEntry(NamedTuple):
    """One command: its name, the module that exports `command`, and its line in ``--help``."""

    name: str
    module: str
    summary: str


COMMANDS: dict[str, tuple[CommandEntry, ...]] = {
    "Start": (
        CommandEntry(
            "demo", "fieldkit.cli.demo", "Run the whole experiment on simulated devices, then report."
        ),
        CommandEntry(
            "init", "fieldkit.cli.init", "Create a campaign: a commented fieldkit.toml and folders."
        ),
        CommandEntry(
            "doctor", "fieldkit.cli.doctor", "Check that this computer is ready; every problem has a fix."
        ),
        CommandEntry(
            "devices", "fieldkit.cli.devices", "List connected instruments and the identity to configure."
        ),
    ),
    "Plan": (
        CommandEntry(
            "plan", "fieldkit.cli.plan", "Show a day's best hours, sensitivity and possible accuracy."
        ),
        CommandEntry(
            "sun", "fieldkit.cli.sun", "Compute sun and incidence angles for places, times, facets."
        ),
    ),
    "Set up": (
        CommandEntry("live", "fieldkit.cli.live", "Show the current frame and readings without recording."),
        CommandEntry("roi", "fieldkit.cli.roi", "Add, list, check, edit or remove regions of the image."),
        CommandEntry(
            "calibrate",
            "fieldkit.cli.calibrate",
            "Calibrate emissivity, offsets, irradiance, surface, clock.",
        ),
    ),
    "Record": (
        CommandEntry("record", "fieldkit.cli.record", "Record a session; Ctrl-C stops and seals it."),
        CommandEntry("status", "fieldkit.cli.status", "Show how the running recording is doing."),
        CommandEntry("stop", "fieldkit.cli.stop", "Stop and seal the running recording."),
        CommandEntry("mark", "fieldkit.cli.mark", "Add a note to the running recording."),
        CommandEntry(
            "page", "fieldkit.cli.page", "Serve the field page: see, draw, start, mark in a browser."
        ),
        CommandEntry(
            "service", "fieldkit.cli.service", "Run the page, and a recording, from boot on (systemd)."
        ),
        CommandEntry("shutter", "fieldkit.cli.shutter", "Run the camera's shutter correction now."),
    ),
    "Afterwards": (
        CommandEntry("ls", "fieldkit.cli.ls", "List the sessions of a campaign."),
        CommandEntry("show", "fieldkit.cli.show", "Summarise one session; --follow while it is recorded."),
        CommandEntry("check", "fieldkit.cli.check", "Check that a session is complete and plausible."),
        CommandEntry("recover", "fieldkit.cli.recover", "Finish a session whose recording was interrupted."),
        CommandEntry("replay", "fieldkit.cli.replay", "Play a session as if live."),
        CommandEntry(
            "import", "fieldkit.cli.import_session", "Make a session of a recording by other software."
        ),
    ),
    "Work": (
        CommandEntry("estimate", "fieldkit.cli.estimate", "Estimate slopes of recorded sessions."),
        CommandEntry("sweep", "fieldkit.cli.sweep", "Estimate sessions with many sets of parameters."),
        CommandEntry("map", "fieldkit.cli.map", "Map tilt and azimuth of every pixel: image and arrays."),
        CommandEntry("report", "fieldkit.cli.report", "Write a session's report: one page with figures."),
        CommandEntry(
            "export", "fieldkit.cli.export", "Export a session as CSV, Parquet, netCDF, images or video."
        ),
        CommandEntry(
            "study", "fieldkit.cli.study", "Reproduce the paper's simulation study: tables and figures."
        ),
    ),
    "Tool": (
        CommandEntry("decode", "fieldkit.cli.decode", "Decode bytes of an instrument."),
        CommandEntry("selftest", "fieldkit.cli.selftest", "Check that a driver meets the driver contract."),
    ),
}
"""All commands, by heading of ``fieldkit --help``."""


COMMON = ("-C", "--json", "-q", "--quiet", "-v", "--verbose", "--no-color", "--no-input")
"""Options that every command takes (`fieldkit.cli.common`)."""


class CommandTable(click.Group):
    """A click group whose commands come from a table and are imported when they run."""

    def __init__(self, table: dict[str, tuple[CommandEntry, ...]], **settings: Any) -> None:
        super().__init__(**settings)
        self.table = table
        self.entries: dict[str, CommandEntry] = {
            entry.name: entry for entries in table.values() for entry in entries
        }

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every command, in the order of the table."""
        return list(self.entries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of this name, or None."""
        if cmd_name not in self.entries:
            return None
        command = importlib.import_module(self.entries[cmd_name].module).command
        assert isinstance(command, click.Command)
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the options before the command; common options belong after it, as the error says."""
        try:
            return super().parse_args(ctx, list(args))
        except click.NoSuchOption as error:
            name = next((word for word in args if word in self.entries), "COMMAND")
            if error.option_name not in COMMON:
                raise
            raise click.UsageError(
                f"{error.option_name} goes after the command: fieldkit {name} {error.option_name} ...", ctx
            ) from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that was typed; for a misspelled one, name the nearest."""
        if args[0] not in self.entries and not args[0].startswith("-"):
            raise click.UsageError(f"there is no command {args[0]!r}{self._nearest(args[0])}", ctx)
        return super().resolve_command(ctx, args)

    def _nearest(self, typed: str) -> str:
        from difflib import get_close_matches

        near = get_close_matches(typed, self.entries, n=1)
        return f"; did you mean {near[0]!r}?" if near else ""

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Completions of a word typed in a shell: commands with their summaries, without importing any."""
        from click.shell_completion import CompletionItem

        names = (name for name in self.entries if name.startswith(incomplete))
        commands = [CompletionItem(name, help=self.entries[name].summary) for name in names]
        return [*commands, *click.Command.shell_complete(self, ctx, incomplete)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings, without importing any."""
        width = max(len(name) for name in self.entries)
        for heading, entries in self.table.items():
            with formatter.section(heading):
                formatter.write_dl([(entry.name.ljust(width), entry.summary) for entry in entries])

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


def _cite(ctx: click.Context, _option: click.Parameter, is_wanted: bool) -> None:
    """Print what a publication should name, and end."""
    if is_wanted and not ctx.resilient_parsing:
        click.echo(CITATION.format(version=__version__))
        ctx.exit()


def _version(ctx: click.Context, _option: click.Parameter, is_wanted: bool) -> None:
    """Print version, commit and source, and end."""
    if is_wanted and not ctx.resilient_parsing:
        from fieldkit.results.origin import origin

        click.echo(f"fieldkit {__version__} ({origin()})")
        ctx.exit()


@click.group(
    cls=CommandTable,
    table=COMMANDS,
    subcommand_metavar="COMMAND [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Version, commit, and where it came from.",
)
@click.option(
    "--cite",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_cite,
    help="What to cite in a publication.",
)
def main() -> None:
    """Terrain slope from surface temperature: record, estimate, report.

    First time here: fieldkit demo
    """
