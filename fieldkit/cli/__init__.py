"""The command line: ``fieldkit VERB``, one module per verb, imported only when it runs.

A verb's module exports `command`, made with ``cls=Verb`` (or ``cls=VerbGroup``) of
`fieldkit.cli.common`. Its row here carries the help line, so ``fieldkit --help``
imports no verb and none of the heavy libraries.
"""

from __future__ import annotations

import importlib
from importlib.metadata import version
from typing import Any, NamedTuple

import click

from fieldkit.cli.failure import explained


class Row(NamedTuple):
    """One verb: its name, the module that exports `command`, and its line in ``--help``."""

    name: str
    module: str
    summary: str


VERBS: dict[str, tuple[Row, ...]] = {
    "Start": (
        Row("demo", "fieldkit.cli.demo", "The whole experiment on simulated devices, then its report."),
        Row("init", "fieldkit.cli.init", "Make a new campaign: a commented fieldkit.toml, folders."),
        Row("doctor", "fieldkit.cli.doctor", "Is this computer ready? Each doubt with its remedy."),
        Row("devices", "fieldkit.cli.devices", "What is plugged in, and the identity to configure."),
    ),
    "Plan": (
        Row("plan", "fieldkit.cli.plan", "Best hours, kelvin per degree, possible accuracy of a day."),
        Row("sun", "fieldkit.cli.sun", "Sun and incidence angles for places, times and facets."),
    ),
    "Set up": (
        Row("live", "fieldkit.cli.live", "Picture and values as they are now, without recording."),
        Row("roi", "fieldkit.cli.roi", "Regions of the picture: add, list, check, edit, remove."),
        Row("calibrate", "fieldkit.cli.calibrate", "Emissivity, offsets, light, scale, clock."),
    ),
    "Record": (
        Row("record", "fieldkit.cli.record", "Record a session; Ctrl-C stops and seals it."),
        Row("status", "fieldkit.cli.status", "How the recording that runs is doing."),
        Row("stop", "fieldkit.cli.stop", "Ask the recording that runs to stop and seal."),
        Row("mark", "fieldkit.cli.mark", "Note something on the recording that runs."),
    ),
    "Afterwards": (
        Row("ls", "fieldkit.cli.ls", "The sessions of a campaign."),
        Row("show", "fieldkit.cli.show", "One session on a page; --follow while it is recorded."),
        Row("check", "fieldkit.cli.check", "Is everything there, and does it make sense?"),
        Row("recover", "fieldkit.cli.recover", "Finish a session whose recording was cut off."),
        Row("replay", "fieldkit.cli.replay", "Play a session as if live."),
        Row("import", "fieldkit.cli.import_session", "Make a session of a recording from elsewhere."),
    ),
    "Work": (
        Row("estimate", "fieldkit.cli.estimate", "Slopes of recorded sessions."),
        Row("sweep", "fieldkit.cli.sweep", "Sessions estimated with many sets of parameters."),
        Row("map", "fieldkit.cli.map", "Tilt and azimuth of every pixel: picture and arrays."),
        Row("report", "fieldkit.cli.report", "A session as one page with figures, to open or print."),
        Row("export", "fieldkit.cli.export", "A session as CSV, Parquet, netCDF, pictures or film."),
        Row("study", "fieldkit.cli.study", "The paper's simulation study, its tables and figures."),
    ),
    "Tool": (
        Row("decode", "fieldkit.cli.decode", "What bytes of an instrument mean."),
        Row("selftest", "fieldkit.cli.selftest", "Does a driver do what every driver must?"),
    ),
}
"""The verb table, by heading of ``fieldkit --help``."""


COMMON = ("-C", "--json", "-q", "--quiet", "-v", "--verbose", "--no-color", "--no-input")
"""Options that every verb takes (`fieldkit.cli.common`)."""


class CommandTable(click.Group):
    """A click group whose commands come from a table and are imported when they run."""

    def __init__(self, table: dict[str, tuple[Row, ...]], **settings: Any) -> None:
        super().__init__(**settings)
        self.table = table
        self.rows = {row.name: row for rows in table.values() for row in rows}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every verb, in the order of the table."""
        return list(self.rows)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The verb's command, or None if there is no such verb."""
        if cmd_name not in self.rows:
            return None
        command = importlib.import_module(self.rows[cmd_name].module).command
        assert isinstance(command, click.Command)
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """The options in front of the verb; for one that belongs behind it, the error says where it goes."""
        try:
            return super().parse_args(ctx, list(args))
        except click.NoSuchOption as error:
            verb = next((word for word in args if word in self.rows), "VERB")
            if error.option_name not in COMMON:
                raise
            raise click.UsageError(
                f"{error.option_name} stands behind the verb: fieldkit {verb} {error.option_name} ...", ctx
            ) from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The verb that was typed; for a misspelled one, name the nearest."""
        if args[0] not in self.rows and not args[0].startswith("-"):
            raise click.UsageError(f"there is no verb {args[0]!r}{self._nearest(args[0])}", ctx)
        return super().resolve_command(ctx, args)

    def _nearest(self, typed: str) -> str:
        from difflib import get_close_matches

        near = get_close_matches(typed, self.rows, n=1)
        return f"; did you mean {near[0]!r}?" if near else ""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs under their headings, without importing any."""
        width = max(len(name) for name in self.rows)
        for heading, rows in self.table.items():
            with formatter.section(heading):
                formatter.write_dl([(row.name.ljust(width), row.summary) for row in rows])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the verb; what fails is explained on stderr and gives its exit code."""
        with explained(ctx):
            return super().invoke(ctx)


CITATION = """\
The program: The fieldkit developers, "fieldkit: terrain slope from surface temperature", version {version}.

The method: Satoshi Watanabe, Kyohei Otsu, Masatsugu Otsuki, Takashi Kubota, Gakuto Masuyama, Kazunori Umeda,
"A Terrain Slope Estimation Scheme using Infrared Camera for Planetary Exploration Rovers".

With every slope: which session, which method, and its uncertainty; fieldkit report prints all three."""


def _cite(ctx: click.Context, _option: click.Parameter, is_wanted: bool) -> None:
    """Print what a publication should name, and end."""
    if is_wanted and not ctx.resilient_parsing:
        click.echo(CITATION.format(version=version("fieldkit")))
        ctx.exit()


@click.group(
    cls=CommandTable,
    table=VERBS,
    subcommand_metavar="VERB [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="fieldkit", message="%(prog)s %(version)s")
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
