"""Outputs of alarms besides the session: a command, an ntfy topic, an MQTT broker.

Each output has threads and a bounded queue of its own, so that a command that hangs or a broker that is away
delays neither the recording nor another output. A failure is reported once, until the output works again.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import signal
import subprocess
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

from fieldkit.model.alarm import alarm_of, phase_of
from fieldkit.model.errors import ConfigError
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.recorder.home_assistant import Publication, alarm_topic

if TYPE_CHECKING:
    from paho.mqtt.client import Client

log: logging.Logger = logging.getLogger(__name__)

WITHIN_S = 10.0
"""Time that one output may take for one alarm."""
HUNG_AFTER_S = WITHIN_S + 5.0
"""Time after which a send beyond its own time limit is left alone, and another alarm may be sent."""
MOST_HUNG = 3
CLOSE_WITHIN_S = 3.0
QUEUE_SIZE = 100
"""Alarms that wait for one output; the oldest is dropped for a new one."""


class AlarmOutput(ABC):
    """One place that alarms are sent to; used by one thread at a time, apart from `cancel` and what hangs.

    What an output does not define does nothing.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """Name in failures."""

    def open(self) -> None:  # noqa: B027  # need not be defined
        """Get ready, such as connect; a failure is reported, and `send` is tried nevertheless."""

    @abstractmethod
    def send(self, event: Event) -> None:
        """Send one alarm within `WITHIN_S`; raises `OSError`."""

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

    def send(self, event: Event) -> None:
        """Queue an alarm's event for every output; anything else is ignored."""
        if phase_of(event) is not None and alarm_of(event).severity >= self._least:
            for channel in self._channels:
                channel.put(partial(channel.output.send, event))

    def publish(self, publication: Publication) -> None:
        """Queue sensors and their states for the MQTT broker, if there is one."""
        for channel in self._channels:
            if isinstance(channel.output, MqttOutput):
                channel.put(partial(channel.output.publish, publication))

    def failures(self, mono_ns: int, time_ns: int) -> Iterator[Event]:
        """An event for each output that has begun to fail since the last call."""
        for channel in self._channels:
            if (text := channel.failure()) is not None:
                text = f"alarms do not reach {channel.output.name}: {text}; recording goes on"
                data = {"output": channel.output.name}
                yield Event(EventKind.ALARM, mono_ns, time_ns, text, "", Severity.WARNING, data)

    def close(self) -> None:
        """Send what waits, for at most three seconds, and end."""
        for channel in self._channels:
            channel.put(None)
        deadline = time.monotonic() + CLOSE_WITHIN_S
        for channel in self._channels:
            channel.join(deadline)


class _Channel:
    """One output's queue and thread."""

    def __init__(self, output: AlarmOutput) -> None:
        self.output = output
        self._queue: queue.Queue[Callable[[], None] | None] = queue.Queue(QUEUE_SIZE)
        self._failures: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._is_failing, self._is_over = False, threading.Event()
        self._hung: list[threading.Thread] = []
        self._thread = threading.Thread(target=self._run, name=f"alarms to {output.name}", daemon=True)
        self._thread.start()

    def put(self, act: Callable[[], None] | None) -> None:
        """Queue what is to be sent, or None for the end."""
        while True:
            with suppress(queue.Full):
                return self._queue.put_nowait(act)
            with suppress(queue.Empty):
                self._queue.get_nowait()

    def failure(self) -> str | None:
        """The next failure that was not reported yet."""
        with suppress(queue.Empty):
            return self._failures.get_nowait()
        return None

    def join(self, deadline: float) -> None:
        """Wait until everything is sent or the deadline (monotonic seconds) has passed."""
        self._thread.join(max(0.0, deadline - time.monotonic()))
        if self._thread.is_alive():
            log.warning("alarms to %s were not all sent", self.output.name)
            self._is_over.set()
            self.output.cancel()

    def _run(self) -> None:
        self._guarded(self.output.open)
        while (act := self._queue.get()) is not None and not self._is_over.is_set():
            self._guarded(act)
        if not self._is_over.is_set():
            self._guarded(self.output.close)

    def _guarded(self, act: Callable[[], None]) -> None:
        try:
            self._in_time(act)
        except Exception as error:
            log.warning("alarms do not reach %s: %s", self.output.name, error)
            if not self._is_failing:
                self._failures.put(str(error) or repr(error))
            self._is_failing = True
        else:
            self._is_failing = False

    def _in_time(self, act: Callable[[], None]) -> None:
        """Act in another thread: a server that answers in drips outlasts the time limit of its socket."""
        self._hung = [one for one in self._hung if one.is_alive()]
        if len(self._hung) >= MOST_HUNG:
            raise TimeoutError(f"{MOST_HUNG} earlier alarms are still on their way")
        done: Future[None] = Future()
        thread = threading.Thread(target=_act, args=(act, done), name=f"to {self.output.name}", daemon=True)
        thread.start()
        if not wait([done], HUNG_AFTER_S).done:
            self._hung.append(thread)
            raise TimeoutError(f"no complete response within {HUNG_AFTER_S:g} s")
        done.result()


def _act(act: Callable[[], None], done: Future[None]) -> None:
    try:
        act()
    except Exception as error:
        done.set_exception(error)
    else:
        done.set_result(None)


@dataclass
class CommandOutput(AlarmOutput):
    """Starts a program for every alarm, without a shell; the alarm is in its environment.

    The variables are named ``FIELDKIT_ALARM``, ``FIELDKIT_PHASE``, ``FIELDKIT_TEXT`` … after `document`. A
    program that does not end in time is killed with its children.
    """

    words: Sequence[str]
    within_s: float = WITHIN_S
    name: str = "the command"
    _process: subprocess.Popen[bytes] | None = field(default=None, repr=False)

    def send(self, event: Event) -> None:
        """Run the program."""
        values = {f"FIELDKIT_{name.upper()}": str(value) for name, value in document(event).items()}
        with subprocess.Popen(
            self.words,
            env={**os.environ, **values},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as self._process:
            try:
                status = self._process.wait(self.within_s)
            except subprocess.TimeoutExpired:
                self.cancel()
                raise TimeoutError(
                    f"{self.words[0]} did not end within {self.within_s:g} s and was killed"
                ) from None
        if status != 0:
            raise OSError(f"{self.words[0]} ended with status {status}")

    def cancel(self) -> None:
        """Kill the program that runs."""
        process = self._process
        if process is not None and process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


_NTFY_PRIORITY = {Severity.INFO: "2", Severity.WARNING: "4", Severity.ERROR: "5"}


@dataclass
class NtfyOutput(AlarmOutput):
    """Posts every alarm to an ntfy topic: one HTTP request, the text as its body."""

    url: str
    token: str = field(default="", repr=False)
    within_s: float = WITHIN_S

    @property
    def name(self) -> str:
        """The server; the topic may be a secret."""
        return f"ntfy at {urlsplit(self.url).netloc}"

    def send(self, event: Event) -> None:
        """Post the alarm."""
        alarm = alarm_of(event)
        headers = {"Title": f"fieldkit {alarm.condition}", "Priority": _NTFY_PRIORITY[event.severity]}
        if self.token:
            headers["Authorization"] = f"Bearer {self.token}"
        request = Request(self.url, event.text.encode(), headers)
        try:
            with urlopen(request, timeout=self.within_s):
                pass
        except HTTPError as error:  # whose text may quote the address, which is a secret
            raise OSError(f"the server answered with status {error.code}") from None


@dataclass
class MqttOutput(AlarmOutput):
    """Publishes every alarm as retained JSON under ``BASE/alarm/CONDITION/SUBJECT``.

    ``BASE/recorder`` is ``recording`` meanwhile, ``ended`` afterwards and, by the broker's will, ``lost`` if
    the recording computer disappears. `url` is ``mqtt://[USER@]HOST[:PORT]/BASE``, or ``mqtts://`` for TLS.
    While the broker is away messages wait, the latest `QUEUE_SIZE` of them.
    """

    url: str
    password: str = field(default="", repr=False)
    within_s: float = WITHIN_S
    _client: Client | None = field(default=None, repr=False)
    _configs: dict[str, str] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        """Raises `ConfigError` if the MQTT library is missing."""
        try:
            import paho.mqtt.client  # noqa: F401
        except ImportError as error:
            fix = "pip install 'fieldkit[alarms]', or set alarms.mqtt = \"\""
            raise ConfigError("alarms.mqtt needs paho-mqtt", fix=fix) from error

    @property
    def name(self) -> str:
        """The broker."""
        return f"MQTT at {urlsplit(self.url).hostname}"

    @property
    def base(self) -> str:
        """The topic above all others."""
        return urlsplit(self.url).path.strip("/") or "fieldkit"

    def open(self) -> None:
        """Connect in the library's own thread, which also connects again."""
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        parts = urlsplit(self.url)
        client = self._client = Client(CallbackAPIVersion.VERSION2)
        if parts.username:
            client.username_pw_set(parts.username, self.password or None)
        if parts.scheme == "mqtts":
            client.tls_set()
        client.max_queued_messages_set(QUEUE_SIZE)
        client.connect_timeout = self.within_s
        client.reconnect_delay_set(1, 30)
        state = f"{self.base}/recorder"
        client.will_set(state, "lost", qos=1, retain=True)
        client.on_connect = lambda connected, *_: self._begin(connected, state)
        client.connect_async(parts.hostname or "localhost", parts.port or _port(parts.scheme), keepalive=30)
        client.loop_start()

    def send(self, event: Event) -> None:
        """Publish the alarm."""
        self._publish(alarm_topic(self.base, alarm_of(event)), json.dumps(document(event)))

    def publish(self, publication: Publication) -> None:
        """Publish sensors that are new, then the states; each is retained."""
        new = {topic: text for topic, text in publication.configs.items() if self._configs.get(topic) != text}
        self._configs |= new
        for topic, text in (new | publication.states).items():
            self._publish(topic, text)

    def _begin(self, client: Client, state: str) -> None:
        """At every connection: a broker that was restarted may have forgotten what it retained."""
        for topic, text in {state: "recording", **self._configs}.items():
            client.publish(topic, text, qos=1, retain=True)

    def _publish(self, topic: str, text: str) -> None:
        if self._client is None:
            raise ConnectionError("no connection was set up")
        deadline = time.monotonic() + self.within_s
        while not self._client.is_connected() and time.monotonic() < deadline:
            time.sleep(0.05)
        is_connected = self._client.is_connected()
        message = self._client.publish(topic, text, qos=1, retain=True)  # kept until the broker is back
        if is_connected:
            message.wait_for_publish(max(0.1, deadline - time.monotonic()))
        if not (is_connected and message.is_published()):
            raise ConnectionError(f"no response within {self.within_s:g} s")

    def close(self) -> None:
        """Report the end and disconnect."""
        if self._client is None:
            return
        with suppress(OSError):
            self._publish(f"{self.base}/recorder", "ended")
        self._client.disconnect()
        self._client.loop_stop()


def _port(scheme: str) -> int:
    return 8883 if scheme == "mqtts" else 1883
