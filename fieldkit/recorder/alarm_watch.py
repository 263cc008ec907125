"""The alarms of a recording: the engine, and the outputs that receive what it raises."""

from __future__ import annotations

from dataclasses import dataclass, field

from fieldkit.estimation.estimator import Minute
from fieldkit.model.samples import Event, Health, Sample
from fieldkit.model.site import RegionRecord
from fieldkit.recorder.alarm_outputs import AlarmOutputs
from fieldkit.recorder.alarms import AlarmEngine
from fieldkit.recorder.home_assistant import HomeAssistant


@dataclass
class AlarmWatch:
    """Function that the recorder calls for every item: returns the events to store, and sends them on.

    Without an `engine` nothing is watched.
    """

    engine: AlarmEngine | None = None
    outputs: AlarmOutputs = field(default_factory=AlarmOutputs)
    sensors: HomeAssistant | None = None

    def update(self, item: Sample | Event | Health | Minute | RegionRecord) -> list[Event]:
        """Alarms raised, acknowledged and cleared; once a second also outputs that begin to fail."""
        events = [] if self.engine is None else self.engine.update(item)
        self._publish(item)
        for event in events:
            self._publish(event)
            self.outputs.send(event)
        if isinstance(item, Health):
            events += self.outputs.failures(item.mono_ns, item.time_ns)
        return events

    def _publish(self, item: object) -> None:
        if self.sensors is not None and (publication := self.sensors.update(item)) is not None:
            self.outputs.publish(publication)

    def close(self) -> None:
        """The recording is over."""
        self.outputs.close()
