"""``fieldkit mark``: add a note to the running recording."""

from __future__ import annotations

from functools import partial

import click

from fieldkit.cli.common import Command, campaign, options, print_json, recordings, say, usage_errors
from fieldkit.cli.types import WORDS


@click.command(cls=Command)
@click.argument("words", metavar="TEXT", type=WORDS, nargs=-1, required=True)
@click.option(
    "-k", "--kind", default="", type=WORDS, metavar="WORD", help="Label to filter by, such as cloud."
)
@click.option(
    "--at", metavar="TIME", help="Time of the event: -30s, -5m, 12:31 (the site's zone), or ISO 8601."
)
@click.option("--from", "start", metavar="TIME", help="Start of an interval; needs --until.")
@click.option("--until", "end", metavar="TIME", help="End of an interval; needs --from.")
@click.pass_context
def command(
    ctx: click.Context, words: tuple[str, ...], kind: str, at: str | None, start: str | None, end: str | None
) -> None:
    r"""Add the note TEXT to the running recording, as an event of its session.

    "shade-test REGION" when a board begins to shade a region, "shade-test REGION end" when it is taken away,
    or "shade-test REGION" with an interval: estimates then know those minutes as shaded.

    \b
    fieldkit mark "wind picks up"
    fieldkit mark "cloud over the ridge" -k cloud --from -4m --until -1m
    fieldkit mark shade-test b15 --at -30s
    fieldkit mark shade-test b15 end
    """
    from fieldkit.recording.mark_times import mark_of
    from fieldkit.recording.requests import sent
    from fieldkit.recording.running import unresponsive_recorder

    if (start is None) != (end is None) or (at and start):
        raise click.UsageError("give --at, or --from and --until together")
    text, folder = " ".join(words), recordings(ctx)
    with usage_errors():
        mark = mark_of(folder, partial(campaign, ctx), text, kind=kind, at=at or start or "-0s", to=end)
    session = sent(folder, mark).session
    if options(ctx).json:
        print_json({"session": str(session), "text": text, "kind": kind, "at": mark.at, "to": mark.to})
    if (silent := unresponsive_recorder(session)) is not None:
        say(f"warning: {silent.at(campaign(ctx).site)}; the mark waits for it beside {session.name}: {text}")
    else:
        say(f"marked in {session.name}: {text}")
