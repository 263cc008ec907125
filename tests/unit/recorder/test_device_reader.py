import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fieldkit.model.clock import HostClock
from fieldkit.model.device import Device, StreamInfo
from fieldkit.model.errors import ConfigError, DeviceLostError, DeviceNotFoundError
from fieldkit.model.samples import Event, EventKind, Frame, Quality, Reading, Severity
from fieldkit.recorder.device_reader import DeviceReader, Sampling
from fieldkit.recorder.sample_queue import SampleQueue
from fieldkit.simulation.simulated_clock import SimulatedClock

S = 1_000_000_000
PICTURE = np.zeros((2, 2), np.uint16)
READERS: list[DeviceReader] = []
"""Those that `run` has used, the last one at the end."""


class Meter:
    """A meter of 1 Hz that is unplugged from `gone` to `back` (seconds since the start)."""

    info = StreamInfo("lux", "illuminance", "lx", (1,), rate_hz=1.0)
    rejected = 0

    def __init__(self, clock: SimulatedClock, start_ns: int, gone: float = 1e9, back: float = 1e9) -> None:
        self.clock, self.start_ns, self.gone, self.back = clock, start_ns, gone, back

    @property
    def is_unplugged(self) -> bool:
        return self.gone <= (self.clock.mono_ns() - self.start_ns) / S < self.back

    def read(self, timeout_s: float) -> Reading | None:
        self.clock.sleep(min(1.0, timeout_s) if timeout_s < 1.0 else 1.0)
        if self.is_unplugged:
            raise DeviceLostError("unplugged")
        now = self.clock.mono_ns()
        return (
            Reading("lux", now, self.clock.to_utc_ns(now), (1.0,)) if (now - self.start_ns) % S == 0 else None
        )

    def close(self) -> None:
        """Nothing is held."""


class Camera(Meter):
    """A camera of 10 Hz; what it is asked to do is noted with the time."""

    info = StreamInfo("camera", "brightness_temperature", "K", (2, 2), rate_hz=10.0)

    def __init__(self, clock: SimulatedClock, start_ns: int, frozen: bool = False) -> None:
        super().__init__(clock, start_ns)
        self.shutter_s: list[float] = []
        self.frozen = frozen

    def read(self, timeout_s: float) -> Frame | None:  # type: ignore[override]
        self.clock.sleep(0.1)
        now = self.clock.mono_ns()
        quality = Quality.FROZEN if self.frozen else Quality.GOOD
        return Frame("camera", now, self.clock.to_utc_ns(now), PICTURE, PICTURE[:0], quality)

    def run_shutter(self) -> bool:
        self.shutter_s.append((self.clock.mono_ns() - self.start_ns) / S)
        return True

    def skip_until(self, mono_ns: int) -> None:
        self.clock.sleep((mono_ns - self.clock.mono_ns()) / S)


def run(
    make: Callable[[SimulatedClock, int], Device],
    reopen: Callable[[Device], Device],
    lasting_s: float,
    sampling: Sampling = Sampling(),  # noqa: B008 - frozen
) -> tuple[list[Reading | Frame], list[Event], int]:
    """Feed one device for a while of simulated time; samples, events and the start."""
    with SimulatedClock(0) as clock:
        start_ns = clock.mono_ns()
        device = make(clock, start_ns)
        inbox = SampleQueue({device.info.name: 10_000})
        end_ns = start_ns + round(lasting_s * S)
        READERS.append(DeviceReader(device, lambda: reopen(device), inbox, clock, sampling, end_ns))
        READERS[-1].start()
        assert READERS[-1].join(500.0)
    items = []
    while (item := inbox.get(0.0)) is not None:
        items.append(item)
    samples = [item for item in items if not isinstance(item, Event)]
    return samples, [item for item in items if isinstance(item, Event)], start_ns


def frozen_camera(clock: SimulatedClock, start_ns: int) -> Camera:
    return Camera(clock, start_ns, frozen=True)


def as_new(kind: type[Meter]) -> Callable[[Device], Device]:
    """What opens a device of that kind in the place of the one that was lost."""
    return lambda device: kind(device.clock, device.start_ns)  # type: ignore[attr-defined]


def same_unless_unplugged(device: Device) -> Device:
    assert isinstance(device, Meter)
    if device.is_unplugged:
        raise DeviceNotFoundError("not plugged in")
    return device


def test_an_unplugged_device_comes_back_and_the_gap_is_told():
    samples, events, start_ns = run(
        lambda c, s: Meter(c, s, gone=10.5, back=20.0), same_unless_unplugged, 40.0
    )
    assert [event.kind for event in events] == [EventKind.LOST, EventKind.BACK]
    back_s = (events[1].mono_ns - start_ns) / S
    # tried again 1, 2, 4 and 8 s apart after the loss at 10.5 or 11 s
    assert 20.0 <= back_s <= 27.0
    assert events[1].data["gap_s"] == (events[1].mono_ns - events[0].mono_ns) / S
    times = [(sample.mono_ns - start_ns) / S for sample in samples]
    assert [t for t in times if t < 10.5] == [float(n) for n in range(1, 11)]
    assert not [t for t in times if 10.5 <= t < 20.0]
    assert len([t for t in times if t >= back_s]) >= 12


def test_a_silent_device_is_lost_at_its_deadline():
    class Silent(Meter):
        def read(self, timeout_s: float) -> None:  # type: ignore[override]
            self.clock.sleep(timeout_s)

    _, events, start_ns = run(Silent, lambda device: device, 4.0)
    assert events[0].kind is EventKind.LOST
    assert (events[0].mono_ns - start_ns) / S == 2.0


def test_a_frozen_picture_is_kept_flagged_and_the_camera_opened_again():
    samples, events, _ = run(frozen_camera, lambda device: device, 3.0)
    assert samples
    assert all(Quality.FROZEN in sample.quality for sample in samples)
    assert [event.kind for event in events][:2] == [EventKind.LOST, EventKind.BACK]


def test_the_same_picture_after_opening_again_is_flagged_as_repeated():
    samples, _, _ = run(frozen_camera, as_new(Camera), 3.0)
    assert [sample.quality for sample in samples[:3]] == [Quality.FROZEN, Quality.DUPLICATE, Quality.GOOD]


def test_another_instrument_under_the_same_name_is_not_taken():
    class Other(Meter):
        info = StreamInfo("lux", "illuminance", "lx", (2,), rate_hz=1.0)

    _, events, _ = run(lambda c, s: Meter(c, s, gone=5.5), as_new(Other), 60.0)
    assert [event.kind for event in events] == [EventKind.LOST]


def test_a_camera_back_with_another_scale_has_no_value():
    class Tenths(Camera):
        info = replace(Camera.info, scale=0.1)

    samples, events, _ = run(frozen_camera, as_new(Tenths), 4.0)
    assert [event.kind for event in events] == [EventKind.LOST, EventKind.BACK, EventKind.LOST]
    assert "linear, 0.1 x" in events[2].text
    assert all(Quality.NO_VALUE in sample.quality for sample in samples[1:])


def test_a_camera_lost_before_its_first_picture_is_opened_again():
    class Shy(Camera):
        def skip_until(self, mono_ns: int) -> None:
            raise DeviceLostError("unplugged")

    samples, events, _ = run(Shy, as_new(Camera), 4.0)
    assert [event.kind for event in events] == [EventKind.LOST, EventKind.BACK]
    assert len(samples) > 20


@pytest.mark.parametrize("mistake", [KeyError, SystemExit, KeyboardInterrupt, GeneratorExit, ConfigError])
def test_a_mistake_of_a_driver_costs_a_moment_and_not_the_stream(mistake):
    class Mistaken(Meter):
        def read(self, timeout_s: float) -> Reading | None:
            reading = super().read(timeout_s)
            if self.clock.mono_ns() - self.start_ns == 5 * S:
                raise mistake("byte 0x17")
            return reading

    tries = []

    def reopen(device: Device) -> Device:
        tries.append(1)
        if len(tries) < 2:
            raise mistake("unplugged while it was looked for")
        return device

    samples, events, start_ns = run(Mistaken, reopen, 20.0)
    assert [(event.kind, event.severity) for event in events] == [
        (EventKind.LOST, Severity.ERROR),
        (EventKind.BACK, Severity.INFO),
    ]
    assert "byte 0x17" in events[0].text
    assert (samples[-1].mono_ns - start_ns) / S >= 19.0


def test_stop_while_lost_does_not_open_the_device_once_more():
    opened = []
    run(
        lambda c, s: Meter(c, s, gone=5.5),
        lambda device: opened.append(1) or device,  # type: ignore[func-returns-value]
        6.5,
    )
    assert not opened


def test_bursts_come_each_period_with_the_shutter_twelve_seconds_before():
    cameras: list[Camera] = []

    def make(clock: SimulatedClock, start_ns: int) -> Camera:
        cameras.append(Camera(clock, start_ns))
        return cameras[0]

    samples, events, start_ns = run(make, lambda device: device, 200.0, Sampling(60.0, 3))
    times = [round((sample.mono_ns - start_ns) / S, 3) for sample in samples]
    first = [0.2, 0.3, 0.4]  # one picture later: what the driver held is let go
    assert times == first + [t + n / 10 for t in (60, 120, 180) for n in (1, 2, 3)]
    assert cameras[0].shutter_s == [48.0, 108.0, 168.0]  # none before the first: it would be late
    assert not events


def test_what_waited_since_the_opening_is_left_out():
    class Late(Meter):
        """Its first record waited in the port: it can only be stamped now, less its wire time."""

        late = True

        def read(self, timeout_s: float) -> Reading | None:
            if self.late:
                self.late = False
                now = self.clock.mono_ns() - 16_700_000
                return Reading("lux", now, self.clock.to_utc_ns(now), (9.0,))
            return super().read(timeout_s)

    samples, _, _ = run(Late, lambda device: device, 3.5)
    assert [sample.values for sample in samples if isinstance(sample, Reading)] == [(1.0,)] * 3


def test_what_waited_since_the_device_was_opened_again_is_left_out_too():
    """A camera that lost its power buffers frames of its old mode until the driver has set it up again."""

    class Buffering(Camera):
        def __init__(self, clock: SimulatedClock, start_ns: int) -> None:
            super().__init__(clock, start_ns)
            clock.sleep(0.5)  # commands
            self.buffered = [clock.mono_ns() - n * S // 10 for n in (5, 4, 3, 2, 1)]

        def skip_until(self, mono_ns: int) -> None:
            """As of a camera without a rate: nothing that is here is let go."""

        def read(self, timeout_s: float) -> Frame | None:  # type: ignore[override]
            if self.buffered:
                stamp = self.buffered.pop(0)
                return Frame("camera", stamp, self.clock.to_utc_ns(stamp), PICTURE + 1, PICTURE[:0])
            return super().read(timeout_s)

    samples, events, _ = run(frozen_camera, as_new(Buffering), 4.0)
    assert [event.kind for event in events] == [EventKind.LOST, EventKind.BACK]
    assert len(samples) > 10
    assert not any(sample.counts.any() for sample in samples)


def test_another_instrument_or_a_lost_setting_is_reported_when_the_device_is_back():
    class Spare(Camera):
        info = replace(Camera.info, serial_number="22", settings={"emissivity": 1.0, "gain": "high"})

    class First(Camera):
        info = replace(Spare.info, serial_number="11", settings={"emissivity": 0.95, "gain": "high"})

    _, events, _ = run(lambda c, s: First(c, s, frozen=True), as_new(Spare), 3.0)
    assert [event.kind for event in events] == [EventKind.LOST, EventKind.BACK]
    assert events[1].severity is Severity.WARNING
    assert events[1].text.endswith("; its serial number is 22, was 11; its emissivity is 1.0, was 0.95")


def test_stamps_never_decrease_and_never_lie_in_the_future_whatever_a_driver_says():
    class Jumpy(Meter):
        """A driver whose stamps are a second late, right, two seconds early, right ..."""

        errors_s = (1, 0, -2, 0)

        def read(self, timeout_s: float) -> Reading | None:
            reading = super().read(timeout_s)
            if reading is None:
                return None
            stamp_ns = reading.mono_ns + self.errors_s[(reading.mono_ns - self.start_ns) // S - 1] * S
            return reading._replace(mono_ns=stamp_ns, time_ns=self.clock.to_utc_ns(stamp_ns))

    samples, _, start_ns = run(Jumpy, lambda device: device, 4.5)
    assert [(sample.mono_ns - start_ns) / S for sample in samples] == [1, 2, 2, 4]
    flagged = [Quality.INTERPOLATED in sample.quality for sample in samples]
    assert flagged == [True, False, True, False]


@pytest.mark.parametrize(
    "stamps", [{"mono_ns": 2**70}, {"mono_ns": float("nan")}, {"mono_ns": -1}, {"time_ns": 2**70}]
)
def test_stamps_outside_the_session_are_flagged_and_become_the_time_of_arrival(stamps):
    class Lost(Meter):
        def read(self, timeout_s: float) -> Reading | None:
            reading = super().read(timeout_s)
            return reading and reading._replace(**stamps)

    samples, events, start_ns = run(Lost, lambda device: device, 6.5)
    seconds = [(sample.mono_ns - start_ns) / S for sample in samples]
    # what comes within 2 s and is stamped before the start may have waited in a buffer
    assert seconds == [2, 3, 4, 5, 6] if stamps == {"mono_ns": -1} else [1, 2, 3, 4, 5, 6]
    assert {sample.mono_ns - sample.time_ns for sample in samples} == {start_ns}  # the clock begins in 1970
    assert {sample.quality for sample in samples} == {Quality.INTERPOLATED}
    assert not events


def test_a_driver_that_hangs_is_lost_after_ten_seconds_delays_no_end_and_may_come_back():
    entered, released = threading.Event(), threading.Event()

    class Hanging(Meter):
        def read(self, timeout_s: float) -> Reading | None:
            entered.set()
            released.wait(60.0)
            return super().read(timeout_s)

    clock, queue = HostClock(), SampleQueue({"lux": 10})
    device = Hanging(clock, clock.mono_ns())
    reader = DeviceReader(device, lambda: device, queue, clock, Sampling())
    reader.start()
    assert entered.wait(10.0)
    for _ in range(20):
        reader.count_second()
    event = queue.get(0.0)
    assert isinstance(event, Event)
    assert (event.kind, event.severity) == (EventKind.LOST, Severity.ERROR)
    assert queue.get(0.0) is None
    released.set()
    assert [queue.get(10.0).kind for _ in range(2)] == [EventKind.LOST, EventKind.BACK]
    released.clear()
    entered.clear()
    assert entered.wait(10.0)
    reader.stop()
    assert reader.is_running
    assert not reader.join(2.1)
    assert not reader.is_running
    released.set()
    assert reader.join(10.0)


def test_a_device_that_stays_away_is_tried_every_half_minute_for_as_long_as_it_takes():
    """1, 2, 4, 8 and 16 s after one another, then every 30 s."""
    tried: list[int] = []

    def never(device: Device) -> Device:
        tried.append(device.clock.mono_ns())
        raise DeviceNotFoundError("not plugged in")

    _, events, _ = run(lambda c, s: Meter(c, s, gone=10.5), never, 300.0)
    waits = np.diff([events[0].mono_ns, *tried]) / S
    assert waits[:5].tolist() == [1.0, 2.0, 4.0, 8.0, 16.0]
    assert set(waits[5:].tolist()) == {30.0}
    assert len(waits) >= 12


def test_garbled_records_are_counted_over_all_openings():
    class Garbled(Meter):
        def __init__(self, clock: SimulatedClock, start_ns: int, rejected: int, gone: float = 1e9) -> None:
            super().__init__(clock, start_ns, gone)
            self.rejected = rejected

    again = iter([(2, 20.5), (4, 1e9)])
    run(
        lambda clock, start_ns: Garbled(clock, start_ns, 3, gone=10.5),
        lambda device: Garbled(device.clock, device.start_ns, *next(again)),
        40.0,
    )
    assert READERS[-1].rejected == 3 + 2 + 4


class Showing(Meter):
    """A meter whose display changes at 5 s, 20 s and 90 s."""

    @property
    def states(self) -> tuple[str, ...]:
        second = (self.clock.mono_ns() - self.start_ns) / S
        return () if second < 5 else ("hold",) if second < 20 else ("low_battery",) if second < 90 else ()

    def read(self, timeout_s: float) -> Reading | None:
        reading = super().read(timeout_s)
        held = self.states == ("hold",)
        return reading._replace(quality=Quality.STALE) if reading is not None and held else reading


def test_what_a_meter_shows_beside_its_values_is_told_when_it_changes_and_not_too_often():
    _, events, start_ns = run(Showing, same_unless_unplugged, 130.0)
    assert {event.kind for event in events} == {EventKind.MODE}
    assert [event.severity for event in events] == [Severity.WARNING, Severity.INFO, Severity.INFO]
    hold, low_battery, nothing = (event.text.split(": ")[2] for event in events)
    assert (hold, low_battery) == ("hold", "low battery")
    assert nothing not in (hold, low_battery)
    assert [round((event.mono_ns - start_ns) / S) for event in events] == [5, 65, 125]


def test_after_a_pause_bursts_keep_their_minutes_and_make_up_for_none():
    """A computer that stood still for four minutes goes on at the next full minute."""

    class Held(Camera):
        def read(self, timeout_s: float) -> Frame | None:  # type: ignore[override]
            if 60.0 < (self.clock.mono_ns() - self.start_ns) / S < 61.0:
                self.clock.sleep(245.0)
            return super().read(timeout_s)

    sampling = Sampling(every_s=60.0, burst_frames=2, shutter_before_burst=False)
    samples, _, start_ns = run(Held, same_unless_unplugged, 500.0, sampling)
    bursts = [(sample.mono_ns - start_ns) / S for sample in samples[::2]]
    assert np.diff(bursts[3:]).tolist() == pytest.approx([60.0] * (len(bursts) - 4))
    assert len(bursts) <= 6


def test_an_impossible_reading_is_flagged_and_counted_as_it_came():
    class Loose(Meter):
        """A probe that shows 9.9E+37 lx, SCPI's overflow, at every second reading."""

        def read(self, timeout_s: float) -> Reading | None:
            reading = super().read(timeout_s)
            is_whole = reading is None or round((reading.mono_ns - self.start_ns) / S) % 2
            return reading if is_whole else reading._replace(values=(9.9e37,))

    readings, _, _ = run(Loose, same_unless_unplugged, 10.0)
    flagged = [reading.values for reading in readings if reading.quality == Quality.IMPLAUSIBLE]
    assert flagged == [(9.9e37,)] * READERS[-1].implausible
    assert len(flagged) == 5
    assert {reading.values for reading in readings if reading.quality == Quality.GOOD} == {(1.0,)}
