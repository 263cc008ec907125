"""The views on a real pseudo-terminal, as the recorder uses them."""

import io
import os
import pty
import threading
import time

import pytest
from rich.console import Console

import fieldkit.views.terminal_view as terminal_view_module
from fieldkit.model.alarm import Alarm, Phase
from fieldkit.model.samples import Event, EventKind, Severity
from fieldkit.views.latest import Latest
from fieldkit.views.terminal_view import PlainView, TerminalView, terminal_view

ENTER_SCREEN, LEAVE_SCREEN, BELL = b"\x1b[?1049h", b"\x1b[?1049l", b"\x07"
ENOUGH_S = 20.0


class Watched:
    """A pseudo-terminal whose output is collected by a thread, unless nobody reads."""

    def __init__(self, *, read: bool = True) -> None:
        self.master, slave = pty.openpty()
        self.file = open(slave, "w", encoding="utf-8")  # noqa: SIM115
        self.console = Console(
            file=self.file, force_terminal=True, color_system="truecolor", width=80, height=24, _environ={}
        )
        self.seen = b""
        self._changed = threading.Condition()
        self.reader = threading.Thread(target=self._read, daemon=True)
        if read:
            self.reader.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self.master, 65536)
            except OSError:
                return
            with self._changed:
                self.seen += data
                self._changed.notify_all()

    def wait_for(self, *wanted: bytes) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: all(part in self.seen for part in wanted), ENOUGH_S), wanted

    def close(self) -> None:
        self.file.close()
        if self.reader.ident:
            self.reader.join(ENOUGH_S)
        os.close(self.master)


@pytest.fixture
def screen_of(site, regions, streams):
    def make(console: Console) -> TerminalView:
        return TerminalView(Latest(site, regions, streams, "three-beds"), console=console, refresh_hz=50)

    return make


def test_screen_appears_with_the_first_item_and_is_given_back(screen_of, frame, make_minute):
    watched = Watched()
    view = screen_of(watched.console)
    view.show(frame)
    view.show(make_minute())
    watched.wait_for(ENTER_SCREEN, b"three-beds", "▀".encode(), b"15.5")
    view.close()
    watched.wait_for(LEAVE_SCREEN)
    watched.close()


def test_alarms_ring_the_bell(screen_of, frame):
    watched = Watched()
    view = screen_of(watched.console)
    view.show(frame)
    watched.wait_for(b"three-beds")
    assert BELL not in watched.seen
    view.show(Alarm("cloud", "", Severity.INFO, 1, "clouds").event(Phase.RAISED, 1, 1))
    watched.wait_for(b"clouds")
    assert BELL not in watched.seen
    view.show(Alarm("lost", "camera", Severity.ERROR, 1, "camera lost").event(Phase.RAISED, 2, 2))
    watched.wait_for(BELL, b"ALARM", b"camera lost")
    view.close()
    watched.close()


def test_show_returns_although_nobody_reads_the_terminal(screen_of, frame, monkeypatch):
    monkeypatch.setattr(terminal_view_module, "CLOSE_WITHIN_S", 0.1)  # a shorter wait
    watched = Watched(read=False)  # a pseudo-terminal holds a few kilobytes, a screen is more
    view = screen_of(watched.console)
    shower = threading.Thread(target=lambda: [view.show(frame) for _ in range(2000)], daemon=True)
    shower.start()
    shower.join(ENOUGH_S)
    assert not shower.is_alive()
    view.close()  # returns too
    watched.reader.start()
    watched.wait_for(LEAVE_SCREEN)
    watched.close()


def test_a_failed_drawing_is_told_and_hurts_nobody(screen_of, frame, monkeypatch):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("no colours left")

    monkeypatch.setattr(terminal_view_module, "screen", fail)  # only a mistake of ours does
    watched = Watched()
    view = screen_of(watched.console)
    view.show(frame)
    watched.wait_for(LEAVE_SCREEN, b"the live view stopped", b"no colours left", b"the recording goes on")
    view.show(frame)
    view.close()
    watched.close()


def test_a_screen_on_a_terminal_and_plain_lines_elsewhere(site, regions, streams):
    watched, latest = Watched(), Latest(site, regions, streams)
    dumb = Console(file=io.StringIO(), force_terminal=True, _environ={"TERM": "dumb"})
    assert isinstance(terminal_view(latest, watched.console), TerminalView)
    for console in (dumb, Console(file=io.StringIO())):
        assert isinstance(terminal_view(latest, console), PlainView)
    watched.close()


@pytest.fixture
def lines(site, regions):
    """What a plain view prints for some items."""

    def printed(*items: object) -> list[str]:
        output = io.StringIO()
        view = PlainView(site, regions, file=output)
        for item in items:
            view.show(item)
        view.close()
        return output.getvalue().splitlines()

    return printed


def test_plain_minute_is_one_line_however_narrow(lines, make_minute):
    (line,) = lines(make_minute(10))
    assert line.startswith(" 12:18 JST  S 835 W/m² (eq10 /0.44, diffuse 15%, horizontal) | flat 26.85 °C | ")
    b15, b25 = line.split(" | ")[2:]
    assert b15.startswith("b15 36.85 °C 15.5 ±1.5° (0.33 K per °) ok")
    assert b25.startswith("b25 46.85 °C 24.0 ±1.0° (0.26 K per °) ")
    assert b25.endswith("43.3°/181°")


def test_plain_events_come_at_once_and_frames_not_at_all(lines, frame, make_minute):
    start_ns = make_minute().time_ns
    lost = Event(EventKind.LOST, 0, start_ns, "camera [lost]", "camera", Severity.WARNING)
    assert lines(frame, lost) == [" 12:08:00 JST  warning: camera [lost]"]


def test_a_closed_pipe_ends_the_printing_not_the_recording(site, regions, make_minute):
    tried, before = [], threading.active_count()

    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            tried.append(text)
            raise BrokenPipeError

    view = PlainView(site, regions, file=Gone())
    for number in range(3):
        view.show(make_minute(number))
    began = time.monotonic()
    view.close()
    assert time.monotonic() - began < 1.0  # nobody is waited for
    assert len(tried) == 1
    assert threading.active_count() == before


def test_a_pipe_that_nobody_reads_holds_nobody_up(site, regions, make_minute):
    reading, writing = os.pipe()
    minutes = [make_minute(number % 60) for number in range(1000)]  # more lines than a pipe takes
    with open(writing, "w", encoding="utf-8") as pipe:
        view = PlainView(site, regions, file=pipe)
        for minute in minutes:
            view.show(minute)
        with open(reading, encoding="utf-8") as reader:
            lines = [reader.readline() for _ in minutes]
        view.close()
    assert all(" JST  S 835 W" in line for line in lines)
