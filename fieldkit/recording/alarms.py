"""From ``[alarms]`` of a campaign to the engine that watches its recordings, and the outputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

from fieldkit.config import Config
from fieldkit.config.toml_schema import AlarmsTable, LimitsTable
from fieldkit.model.alarm import Condition, Rule
from fieldkit.model.device import StreamInfo, regions_on
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Frame, Severity, is_showable
from fieldkit.model.site import RegionRecord
from fieldkit.recorder.alarm_outputs import (
    AlarmOutput,
    AlarmOutputs,
    AlarmWatch,
    CommandOutput,
    MqttOutput,
    output_at,
)
from fieldkit.recorder.alarms import AlarmEngine, AlarmSettings, Limits
from fieldkit.recorder.home_assistant import HomeAssistant
from fieldkit.recording.preflight import sampling_of
from fieldkit.views import frame_image
from fieldkit.views.latest import Latest

UNKNOWN_INTERVAL_S = 5.0
"""Between samples of a stream that does not declare its rate."""


def alarm_watch(config: Config, streams: Sequence[StreamInfo]) -> AlarmWatch:
    """The alarms of a recording; raises `ConfigError` if an output cannot be set up."""
    outputs = tuple(outputs_of(config))
    image = LastImage(config, streams) if config.tables.alarms.image and outputs else None
    sensors = _sensors(config, streams, outputs, image) if config.tables.alarms.home_assistant else None
    engine = AlarmEngine(alarm_settings(config, streams))
    return AlarmWatch(engine, AlarmOutputs(outputs, least_sent(config)), sensors, image)


class LastImage:
    """The last frame of each camera that is fit to be shown, drawn when an image is needed."""

    def __init__(self, config: Config, streams: Sequence[StreamInfo]) -> None:
        self._latest = Latest(config.site, config.regions, streams)

    def update(self, item: object) -> None:
        """Keep a frame and the regions as they are redrawn; ignore anything else."""
        if isinstance(item, RegionRecord) or (isinstance(item, Frame) and is_showable(item.quality)):
            self._latest.update(item)

    def draw(self, subject: str) -> bytes:
        """The frame of a camera, of a region's, or else of the first, as a PNG; `LookupError` without one."""
        latest = self._latest
        cameras = {region.name: region.camera for region in latest.regions}
        frame = latest.frames.get(subject) or latest.frame_of(cameras.get(subject, ""))
        if frame is None:
            raise LookupError("no frame yet")
        regions = regions_on(frame.stream, latest.regions, latest.streams.values())
        return frame_image.png(frame, latest.streams[frame.stream], regions)


def _sensors(
    config: Config, streams: Sequence[StreamInfo], outputs: Sequence[AlarmOutput], image: LastImage | None
) -> HomeAssistant:
    broker = next((output for output in outputs if isinstance(output, MqttOutput)), None)
    if broker is None:
        fix = "write mqtt://HOST/TOPIC into the file that alarms.services_file names"
        raise ConfigError("needs the broker of Home Assistant", place="alarms.home_assistant", fix=fix)
    title = config.tables.campaign.title or config.directory.name
    return HomeAssistant(broker.base, title, streams, least_sent(config), image.draw if image else None)


def least_sent(config: Config) -> Severity:
    """The least severity of alarms that go anywhere but to session and views."""
    return Severity[config.tables.alarms.send.upper()]


def alarm_settings(config: Config, streams: Sequence[StreamInfo]) -> AlarmSettings:
    """Conditions that raise alarms while these streams are recorded."""
    table = config.tables.alarms
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
    values = ((limit.name, getattr(table, limit.name)) for limit in fields(Limits))
    return replace(otherwise or Limits(), **{name: value for name, value in values if value is not None})


def _interval_s(config: Config, info: StreamInfo) -> float:
    """Expected time from one sample of a stream to the next."""
    every_s = sampling_of(config).every_s
    if info.is_camera and every_s is not None:
        return every_s
    return 1.0 / info.rate_hz if info.rate_hz > 0 else UNKNOWN_INTERVAL_S


def outputs_of(config: Config) -> Iterator[AlarmOutput]:
    """Where alarms go; raises `ConfigError` for a file of services that cannot be used."""
    if config.tables.alarms.command:
        yield CommandOutput(tuple(config.tables.alarms.command))
    if config.tables.alarms.services_file:
        path = (config.directory / Path(config.tables.alarms.services_file).expanduser()).resolve()
        for number, line in enumerate(_private_lines(path, config.directory), start=1):
            if line and not line.startswith("#"):
                yield output_at(line, number)


def _private_lines(path: Path, campaign: Path) -> list[str]:
    """Lines of a file that holds tokens: only its owner reads it, and a campaign is given to others."""
    place = f"alarms.services_file: {path}"
    if path.is_relative_to(campaign.resolve()):
        fix = f"move it out of the campaign, such as to ~/.config/fieldkit/{path.name}"
        raise ConfigError("holds tokens, and would be given away with the campaign", place=place, fix=fix)
    try:
        mode, text = path.stat().st_mode, path.read_text(encoding="utf-8-sig")
    except OSError as error:
        fix = "write one address a line into that file"
        raise ConfigError("cannot be read", place=place, fix=fix) from error
    except UnicodeDecodeError:  # which would quote the text
        raise ConfigError("is not UTF-8 text", place=place, fix="write one address a line") from None
    if mode & 0o077:
        raise ConfigError("holds tokens, and others can read it", place=place, fix=f"chmod 600 {path}")
    return [line.strip() for line in text.splitlines()]
