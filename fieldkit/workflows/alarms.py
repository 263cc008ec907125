"""From ``[alarms]`` of a campaign to the engine that watches its recordings, and the outputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

from fieldkit.config import Config
from fieldkit.config.toml_schema import AlarmsTable, LimitsTable
from fieldkit.model.alarm import Condition
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Severity
from fieldkit.recorder.alarm_outputs import (
    AlarmOutput,
    AlarmOutputs,
    CommandOutput,
    MqttOutput,
    NtfyOutput,
)
from fieldkit.recorder.alarm_watch import AlarmWatch
from fieldkit.recorder.alarms import RULES, AlarmEngine, AlarmSettings, Limits, Rule
from fieldkit.workflows.preflight import sampling_of

UNKNOWN_INTERVAL_S = 5.0
"""Between samples of a stream that does not declare its rate."""


def alarm_watch(config: Config, streams: Sequence[StreamInfo]) -> AlarmWatch:
    """The alarms of a recording; raises `ConfigError` if an output cannot be set up."""
    outputs = AlarmOutputs(tuple(_outputs(config)), least_sent(config))
    return AlarmWatch(AlarmEngine(alarm_settings(config, streams)), outputs)


def least_sent(config: Config) -> Severity:
    """The least severity of alarms that go anywhere but to session and views."""
    return Severity[config.alarms.send.upper()]


def alarm_settings(config: Config, streams: Sequence[StreamInfo]) -> AlarmSettings:
    """What raises alarms while these streams are recorded."""
    table = config.alarms
    everywhere = _limits(table)
    limits = {name: _limits(own, everywhere) for name, own in table.region.items()}
    return AlarmSettings(
        rules={condition: _rule(table, condition) for condition in Condition},
        intervals_s={info.name: _interval_s(config, info) for info in streams},
        garbled_per_min=table.garbled_per_min,
        other_limits=everywhere,
        limits=limits,
    )


def _rule(table: AlarmsTable, condition: Condition) -> Rule:
    rule, name = RULES[condition], condition.value
    severity = table.severity.get(name)  # type: ignore[call-overload]
    return replace(
        rule,
        severity=rule.severity if severity is None else Severity[severity.upper()],
        hold_s=table.hold_s.get(name, rule.hold_s),  # type: ignore[call-overload]
        clear_s=table.clear_s.get(name, rule.clear_s),  # type: ignore[call-overload]
        off=name in table.off,
    )


def _limits(table: LimitsTable, otherwise: Limits | None = None) -> Limits:
    names = [one.name for one in fields(Limits)]
    given = {name: getattr(table, name) for name in names if getattr(table, name) is not None}
    return replace(otherwise or Limits(), **given)


def _interval_s(config: Config, info: StreamInfo) -> float:
    """Expected time from one sample of a stream to the next."""
    every_s = sampling_of(config).every_s
    if info.is_camera and every_s is not None:
        return every_s
    return 1.0 / info.rate_hz if info.rate_hz > 0 else UNKNOWN_INTERVAL_S


def _outputs(config: Config) -> Iterator[AlarmOutput]:
    table = config.alarms
    if table.command:
        yield CommandOutput(tuple(table.command))
    if table.ntfy:
        yield NtfyOutput(table.ntfy, _secret(config, "ntfy_token_file", table.ntfy_token_file))
    if table.mqtt:
        yield MqttOutput(table.mqtt, _secret(config, "mqtt_password_file", table.mqtt_password_file))


def _secret(config: Config, key: str, name: str) -> str:
    """What a file beside the configuration holds; sessions store the configuration, so it is not in there."""
    if not name:
        return ""
    path = config.directory / Path(name).expanduser()
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"alarms.{key}: {path} cannot be read", fix="name a file that holds nothing but the secret"
        ) from error
