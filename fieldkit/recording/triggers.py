"""From ``[trigger.NAME]`` of a campaign to the triggers of its recordings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fieldkit.config import Config
from fieldkit.config.toml_schema import TriggerTable
from fieldkit.model.channels import quantity_of
from fieldkit.model.device import StreamInfo
from fieldkit.recorder.triggers import Trigger, Triggers
from fieldkit.recording.preflight import Notify


def triggers_of(config: Config, streams: Sequence[StreamInfo], notify: Notify) -> Triggers:
    """The triggers of channels that there are; `notify` receives a warning of every other."""
    return Triggers(list(_triggers(config, {info.name: info for info in streams}, notify)))


def _triggers(config: Config, streams: dict[str, StreamInfo], notify: Notify) -> Iterator[Trigger]:
    for name, table in config.tables.trigger.items():
        stream, _, channel = table.channel.partition(":")
        info = streams.get(stream)
        names = info.channel_names if info and not info.is_camera else ()
        if info is not None and (channel in names or (names and not channel)):
            yield _trigger(name, table, info, names.index(channel) if channel else 0)
        else:
            notify(f"trigger.{name}: there is no channel {table.channel}, so it never acts")


def _trigger(name: str, table: TriggerTable, info: StreamInfo, channel: int) -> Trigger:
    shown, limits = quantity_of(info).shown, {"above": table.above, "below": table.below}
    words = [f"{side} {limit:g} {shown.shown}" for side, limit in limits.items() if limit is not None]
    high, low = (
        otherwise if limit is None else (limit + shown.add) / shown.by
        for limit, otherwise in zip(limits.values(), (math.inf, -math.inf), strict=True)
    )
    text = f"{table.channel} {' or '.join(words)}"
    return Trigger(name, table.do, info.name, channel, low, high, table.hold_s, table.before_s, text)
