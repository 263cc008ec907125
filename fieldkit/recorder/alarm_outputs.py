"""Outputs of alarms besides the session: a command, services such as Telegram or mail, an MQTT broker.

Each output has threads and a bounded queue of its own, so that a command that hangs or a broker that is away
delays neither the recording nor another output. A failure is reported once, until the output works again.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import re
import signal
import subprocess
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from tempfile import NamedTemporaryFile
from typing import ClassVar, Protocol
from urllib.parse import unquote, urlsplit

from fieldkit.estimation.estimator import Minute
from fieldkit.model.alarm import Alarm, Phase, alarm_of, phase_of
from fieldkit.model.errors import ConfigError
from fieldkit.model.installation import install_extra
from fieldkit.model.samples import Event, EventKind, Health, Sample, Severity
from fieldkit.model.site import RegionRecord
from fieldkit.recorder import daemon
from fieldkit.recorder.alarms import AlarmEngine
from fieldkit.recorder.home_assistant import HomeAssistant, Publication, alarm_topic

log: logging.Logger = logging.getLogger(__name__)

WITHIN_S = 10.0
"""Time that one output may take for one alarm."""
HUNG_AFTER_S = WITHIN_S + 5.0
"""Time after which a send beyond its own time limit is left alone, and another alarm may be sent."""
MOST_HUNG = 3
CLOSE_WITHIN_S = 3.0
QUEUE_SIZE = 100
"""Alarms that wait for one output; the oldest is dropped for a new one."""
Draw = Callable[[str], bytes]
"""Draws the present image of a camera, or of that which sees a region, as a PNG."""


class AlarmOutput(ABC):
    """One place that alarms are sent to; used by one thread at a time, apart from `cancel` and what hangs.

    What an output does not define does nothing.
    """

    name: str
    """Name in failures; nothing secret is in it."""

    def open(self) -> None:  # noqa: B027  # need not be defined
        """Get ready, such as connect; a failure is reported, and `send` is tried nevertheless."""

    @abstractmethod
    def send(self, event: Event, image: str = "") -> None:
        """Send one alarm, with the path of a PNG if there is one, within `WITHIN_S`; raises `OSError`."""

    def cancel(self) -> None:  # noqa: B027  # need not be defined
        """End a `send` that is under way: the recording is over. Called from another thread.

        Not needed where it ends by its own time limit: its thread does not hold up the program.
        """

    def close(self) -> None:  # noqa: B027  # need not be defined
        """The recording is over."""


def document(event: Event) -> dict[str, str | int]:
    """An alarm's event as flat values, for JSON and for the environment of a command."""
    values = {name: event.data[name] for name in ("alarm", "phase", "condition", "subject", "severity")}
    return {**values, "text": event.text, "time_ns": event.time_ns, "since_ns": event.data["since_ns"]}


class AlarmOutputs:
    """Sends alarms of at least a severity to all outputs; never waits for them."""

    def __init__(self, outputs: Sequence[AlarmOutput] = (), least: Severity = Severity.INFO) -> None:
        self._channels, self._least = [_Channel(output) for output in outputs], least

    def send(self, event: Event, draw: Draw | None = None) -> None:
        """Queue an alarm's event for every output, with an image once it is raised; ignore anything else."""
        if (phase := phase_of(event)) is not None and alarm_of(event).severity >= self._least:
            for channel in self._channels:
                channel.put(partial(_send, channel.output, event, draw if phase is Phase.RAISED else None))

    def publish(self, publication: Publication) -> None:
        """Queue sensors and their states for the MQTT broker, if there is one."""
        for channel in self._channels:
            if isinstance(channel.output, MqttOutput):
                channel.put(partial(channel.output.publish, publication))

    def failures(self, mono_ns: int, time_ns: int) -> Iterator[Event]:
        """An event for each output that has begun to fail since the last call."""
        for channel in self._channels:
            if channel.failures:
                problem = channel.failures.popleft()
                text = f"alarms do not reach {channel.output.name}: {problem}; recording goes on"
                data = {"output": channel.output.name}
                yield Event(EventKind.ALARM, mono_ns, time_ns, text, "", Severity.WARNING, data)

    def close(self) -> None:
        """Send what waits, for at most three seconds, and end."""
        for channel in self._channels:
            channel.put(None)
        deadline = time.monotonic() + CLOSE_WITHIN_S
        for channel in self._channels:
            channel.join(deadline)


def _send(output: AlarmOutput, event: Event, draw: Draw | None) -> None:
    """Send an alarm, without its image where that cannot be drawn."""
    image = ""
    with ExitStack() as opened:
        with suppress(Exception):  # a full disk costs the image, not the alarm
            if draw is not None:
                file = opened.enter_context(NamedTemporaryFile(prefix="fieldkit-", suffix=".png"))
                file.write(draw(alarm_of(event).subject))
                file.flush()
                image = file.name
        output.send(event, image)


class _Channel:
    """One output's queue and thread."""

    def __init__(self, output: AlarmOutput) -> None:
        self.output = output
        self._queue: queue.Queue[Callable[[], None] | None] = queue.Queue(QUEUE_SIZE)
        self.failures: deque[str] = deque()
        """Failures that were not reported yet."""
        self._is_failing, self._is_over = False, threading.Event()
        self._hung: list[Future[None]] = []
        self._thread = threading.Thread(target=self._run, name=f"alarms to {output.name}", daemon=True)
        self._thread.start()

    def put(self, act: Callable[[], None] | None) -> None:
        """Queue what is to be sent, or None for the end."""
        while True:
            with suppress(queue.Full):
                return self._queue.put_nowait(act)
            with suppress(queue.Empty):
                self._queue.get_nowait()

    def join(self, deadline: float) -> None:
        """Wait until everything is sent or the deadline (monotonic seconds) has passed."""
        self._thread.join(max(0.0, deadline - time.monotonic()))
        if self._thread.is_alive():
            log.warning("alarms to %s were not all sent", self.output.name)
            self._is_over.set()
            self.output.cancel()

    def _run(self) -> None:
        self._guard(self.output.open)
        while (act := self._queue.get()) is not None and not self._is_over.is_set():
            self._guard(act)
        if not self._is_over.is_set():
            self._guard(self.output.close)

    def _guard(self, act: Callable[[], None]) -> None:
        try:
            self._in_time(act)
        except BaseException as error:  # of a service's library, also SystemExit
            log.warning("alarms do not reach %s: %s", self.output.name, error)
            if not self._is_failing:
                self.failures.append(str(error) or repr(error))
            self._is_failing = True
        else:
            self._is_failing = False

    def _in_time(self, act: Callable[[], None]) -> None:
        """Act in another thread: a server that answers in drips outlasts the time limit of its socket."""
        self._hung = [sending for sending in self._hung if not sending.done()]
        if len(self._hung) >= MOST_HUNG:
            raise TimeoutError(f"{MOST_HUNG} earlier alarms are still on their way")
        sending = daemon.start(act, f"to {self.output.name}")
        if not wait([sending], HUNG_AFTER_S).done:
            self._hung.append(sending)
            raise TimeoutError(f"no complete response within {HUNG_AFTER_S:g} s")
        sending.result()


class CommandOutput(AlarmOutput):
    """Starts a program for every alarm, without a shell; the alarm is in its environment.

    The variables are named ``FIELDKIT_ALARM``, ``FIELDKIT_PHASE``, ``FIELDKIT_TEXT`` … after `document`. A
    program that does not end in time is killed with its children.
    """

    name = "the command"

    def __init__(self, words: Sequence[str]) -> None:
        self._words = words
        self._process: subprocess.Popen[bytes] | None = None

    def send(self, event: Event, image: str = "") -> None:
        """Run the program; the image is gone when it has ended."""
        program, silent, facts = self._words[0], subprocess.DEVNULL, {**document(event), "image": image}
        values = {f"FIELDKIT_{name.upper()}": str(value) for name, value in facts.items()}
        with subprocess.Popen(
            self._words,
            env={**os.environ, **values},
            stdin=silent,
            stdout=silent,
            stderr=silent,
            start_new_session=True,
        ) as self._process:
            try:
                status = self._process.wait(WITHIN_S)
            except subprocess.TimeoutExpired:
                self.cancel()
                raise TimeoutError(f"{program} did not end within {WITHIN_S:g} s and was killed") from None
        if status != 0:
            raise OSError(f"{program} ended with status {status}")

    def cancel(self) -> None:
        """Kill the program that runs."""
        process = self._process
        if process is not None and process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def output_at(address: str, line: int) -> AlarmOutput:
    """Output for a line of `alarms.services_file`: a broker, or a service that apprise knows.

    Raises `ConfigError`, which does not quote the address: it holds a token.
    """
    try:
        return MqttOutput(address) if re.match("mqtts?://", address) else ServiceOutput(address, line)
    except ImportError as error:
        fix = f"{install_extra('alarms')}, or remove alarms.services_file"
        raise ConfigError(f"needs {error.name}", place="alarms.services_file", fix=fix) from error
    except ValueError:
        place = f"line {line} of alarms.services_file"
        fix = "write one such as tgram://TOKEN/CHAT or mqtt://USER:PASSWORD@HOST/TOPIC, with / as %2F inside"
        raise ConfigError("not an address of a service", place=place, fix=fix) from None


class ServiceOutput(AlarmOutput):
    """Sends every alarm to a service that apprise knows."""

    _TYPES: ClassVar = {Severity.INFO: "info", Severity.WARNING: "warning", Severity.ERROR: "failure"}

    def __init__(self, address: str, line: int) -> None:
        """Raises `ValueError` for an address that apprise does not know."""
        from apprise import Apprise

        for logger in ("apprise", "urllib3"):  # both write addresses into the log
            logging.getLogger(logger).setLevel(logging.CRITICAL + 1)
        if (service := Apprise.instantiate(address)) is None:
            raise ValueError
        self._service, self.name = service, f"{service.service_name} (line {line} of alarms.services_file)"

    def send(self, event: Event, image: str = "") -> None:
        """Send the alarm, without the image if the service does not accept it with that."""
        title, kind = f"fieldkit {alarm_of(event).condition}", self._TYPES[event.severity]
        notify = partial(self._service.notify, body=event.text, title=title, notify_type=kind)
        try:
            is_accepted = (image and notify(attach=image)) or notify()
        except Exception as error:  # whose text may quote the address
            raise OSError(f"the service failed: {type(error).__name__}") from None
        if not is_accepted:
            raise OSError("the service is away, or did not accept the alarm")


class MqttOutput(AlarmOutput):
    """Publishes every alarm as retained JSON under ``BASE/alarm/CONDITION/SUBJECT``.

    ``BASE/recorder`` is ``recording`` meanwhile, ``ended`` afterwards and, by the broker's will, ``lost`` if
    the recording computer disappears. The address is ``mqtt://[USER[:PASSWORD]@]HOST[:PORT]/BASE``, or
    ``mqtts://`` for TLS. While the broker is away messages wait, the latest `QUEUE_SIZE` of them.
    """

    def __init__(self, address: str) -> None:
        """Raises `ValueError` for an address without a host."""
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        parts = urlsplit(address)
        is_secure = parts.scheme == "mqtts"
        self._host, self._port = parts.hostname or "", parts.port or (8883 if is_secure else 1883)
        if not self._host:
            raise ValueError
        self.name, self.base = f"MQTT at {self._host}", parts.path.strip("/") or "fieldkit"
        self._configs: dict[str, str] = {}
        self._client = client = Client(CallbackAPIVersion.VERSION2)
        if parts.username:
            client.username_pw_set(unquote(parts.username), unquote(parts.password or "") or None)
        if is_secure:
            client.tls_set()
        client.max_queued_messages_set(QUEUE_SIZE)
        client.connect_timeout = WITHIN_S
        client.reconnect_delay_set(1, 30)
        client.will_set(f"{self.base}/recorder", "lost", qos=1, retain=True)
        client.on_connect = lambda *_: self._begin()

    def open(self) -> None:
        """Connect in the library's own thread, which also connects again."""
        self._client.connect_async(self._host, self._port, keepalive=30)
        self._client.loop_start()

    def send(self, event: Event, image: str = "") -> None:
        """Publish the alarm; images have a topic of their own."""
        self._publish(alarm_topic(self.base, alarm_of(event)), json.dumps(document(event)))

    def publish(self, publication: Publication) -> None:
        """Publish sensors that are new, then the states; each is retained."""
        new = {topic: text for topic, text in publication.configs.items() if self._configs.get(topic) != text}
        self._configs |= new
        for topic, payload in (new | publication.states).items():
            self._publish(topic, payload() if callable(payload) else payload)

    def _begin(self) -> None:
        """At every connection: a broker that was restarted may have forgotten what it retained."""
        for topic, text in {f"{self.base}/recorder": "recording", **self._configs}.items():
            self._client.publish(topic, text, qos=1, retain=True)

    def _publish(self, topic: str, text: str | bytes) -> None:
        deadline = time.monotonic() + WITHIN_S
        while not self._client.is_connected() and time.monotonic() < deadline:
            time.sleep(0.05)
        is_connected = self._client.is_connected()
        message = self._client.publish(topic, text, qos=1, retain=True)  # kept until the broker is back
        if is_connected:
            message.wait_for_publish(max(0.1, deadline - time.monotonic()))
        if not (is_connected and message.is_published()):
            raise ConnectionError(f"no response within {WITHIN_S:g} s")

    def close(self) -> None:
        """Report the end and disconnect."""
        with suppress(OSError):
            self._publish(f"{self.base}/recorder", "ended")
        self._client.disconnect()
        self._client.loop_stop()


class AlarmImage(Protocol):
    """Keeps what is needed to draw an image once an alarm is raised."""

    def update(self, item: object) -> None:
        """Take whatever was recorded."""

    def draw(self, subject: str) -> bytes:
        """The image of a camera or region as a PNG, from any thread; raises `LookupError` without a frame."""


@dataclass
class AlarmWatch:
    """Function that the recorder calls for every item: returns the events to store, and sends them on.

    Without an `engine` nothing is watched.
    """

    engine: AlarmEngine | None = None
    outputs: AlarmOutputs = field(default_factory=AlarmOutputs)
    sensors: HomeAssistant | None = None
    image: AlarmImage | None = None

    @property
    def present(self) -> tuple[Alarm, ...]:
        """The alarms that are present now, oldest first."""
        return () if self.engine is None else self.engine.present

    def update(self, item: Sample | Event | Health | Minute | RegionRecord) -> list[Event]:
        """Alarms raised, acknowledged and cleared; once a second also outputs that begin to fail."""
        events = [] if self.engine is None else self.engine.update(item)
        if self.image is not None:
            self.image.update(item)
        self._publish(item)
        for event in events:
            self._publish(event)
            self.outputs.send(event, self.image.draw if self.image else None)
        if isinstance(item, Health):
            events += self.outputs.failures(item.mono_ns, item.time_ns)
        return events

    def _publish(self, item: object) -> None:
        if self.sensors is not None and (publication := self.sensors.update(item)) is not None:
            self.outputs.publish(publication)

    def close(self) -> None:
        """The recording is over."""
        self.outputs.close()
