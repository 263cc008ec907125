"""From ``[alarms]`` of a campaign to the engine that watches its recordings, and the outputs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

from fieldkit.config import Config
from fieldkit.config.toml_schema import AlarmsTable, LimitsTable
from fieldkit.model.alarm import Condition, Rule
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
from fieldkit.recorder.alarms import AlarmEngine, AlarmSettings, Limits
from fieldkit.recorder.home_assistant import HomeAssistant
from fieldkit.recording.preflight import sampling_of

SECRETS = {
    "ntfy_file": (r"https?://[A-Za-z0-9.:\[\]_-]+/[!-~]+", "an address like https://ntfy.sh/TOPIC"),
    "ntfy_token_file": (r"[!-~]+", "a token"),
    "mqtt_password_file": (r".+", "a password"),
}
"""Content of the files of secrets: a form which no error of an output needs to quote, and its name."""
ONLY_THE_SECRET = "name a file that holds nothing but the secret, on one line"
UNKNOWN_INTERVAL_S = 5.0
"""Between samples of a stream that does not declare its rate."""


def alarm_watch(config: Config, streams: Sequence[StreamInfo]) -> AlarmWatch:
    """The alarms of a recording; raises `ConfigError` if an output cannot be set up."""
    outputs = AlarmOutputs(tuple(outputs_of(config)), least_sent(config))
    return AlarmWatch(AlarmEngine(alarm_settings(config, streams)), outputs, _sensors(config, streams))


def _sensors(config: Config, streams: Sequence[StreamInfo]) -> HomeAssistant | None:
    if not config.alarms.home_assistant:
        return None
    if not config.alarms.mqtt:
        fix = 'set alarms.mqtt = "mqtt://HOST/TOPIC"'
        raise ConfigError("alarms.home_assistant needs the broker of Home Assistant", fix=fix)
    title = config.campaign.title or config.directory.name
    return HomeAssistant(MqttOutput(config.alarms.mqtt).base, title, streams, least_sent(config))


def least_sent(config: Config) -> Severity:
    """The least severity of alarms that go anywhere but to session and views."""
    return Severity[config.alarms.send.upper()]


def alarm_settings(config: Config, streams: Sequence[StreamInfo]) -> AlarmSettings:
    """Conditions that raise alarms while these streams are recorded."""
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
    rule, severity = condition.rule, table.severity.get(condition)
    return replace(
        rule,
        severity=rule.severity if severity is None else Severity[severity.upper()],
        hold_s=table.hold_s.get(condition, rule.hold_s),
        clear_s=table.clear_s.get(condition, rule.clear_s),
        off=condition in table.off,
    )


def _limits(table: LimitsTable, otherwise: Limits | None = None) -> Limits:
    names = [field.name for field in fields(Limits)]
    given = {name: getattr(table, name) for name in names if getattr(table, name) is not None}
    return replace(otherwise or Limits(), **given)


def _interval_s(config: Config, info: StreamInfo) -> float:
    """Expected time from one sample of a stream to the next."""
    every_s = sampling_of(config).every_s
    if info.is_camera and every_s is not None:
        return every_s
    return 1.0 / info.rate_hz if info.rate_hz > 0 else UNKNOWN_INTERVAL_S


def outputs_of(config: Config) -> Iterator[AlarmOutput]:
    """Where alarms go; raises `ConfigError` for a file that holds no secret of its kind."""
    table = config.alarms
    if table.command:
        yield CommandOutput(tuple(table.command))
    if table.ntfy_file:
        yield NtfyOutput(_secret(config, "ntfy_file"), _secret(config, "ntfy_token_file"))
    if table.mqtt:
        yield MqttOutput(table.mqtt, _secret(config, "mqtt_password_file"))


def _secret(config: Config, key: str) -> str:
    """Content of a file beside the configuration; sessions store the configuration, so it is not in there."""
    name = getattr(config.alarms, key)
    if not name:
        return ""
    path, (form, what) = config.directory / Path(name).expanduser(), SECRETS[key]
    try:
        text = path.read_text(encoding="utf-8-sig").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"alarms.{key}: {path} cannot be read", fix=ONLY_THE_SECRET) from error
    if not re.fullmatch(form, text):
        raise ConfigError(f"alarms.{key}: {path} does not hold {what}", fix=ONLY_THE_SECRET)
    return text
