from concurrent.futures import Future

from fieldkit.estimation.estimator import Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, EventKind, Quality, Reading
from fieldkit.recorder.sample_queue import SampleQueue, queue_limit


def reading(n: int, stream: str = "lux") -> Reading:
    return Reading(stream, mono_ns=n, time_ns=n, values=(float(n),))


def drain(inbox: SampleQueue) -> list[object]:
    items = []
    while (item := inbox.get(0.0)) is not None:
        items.append(item)
        inbox.finish(item)
    return items


def test_keeps_the_order_of_arrival_over_streams():
    inbox = SampleQueue({"lux": 4, "camera": 4})
    put = [reading(1), reading(2, "camera"), reading(3)]
    for sample in put:
        assert inbox.put(sample)
    assert drain(inbox) == put
    assert not inbox.is_busy()


def test_large_cameras_may_wait_five_seconds_and_small_ones_32_megabytes():
    def picture(rows: int, cols: int, rate_hz: float) -> StreamInfo:
        return StreamInfo("camera", "brightness_temperature", "K", (rows, cols), rate_hz=rate_hz)

    assert queue_limit(picture(512, 640, 30.0)) == 150
    assert queue_limit(picture(192, 256, 25.0)) == 32_000_000 // (192 * 256 * 2 + 1000)
    assert queue_limit(StreamInfo("lux", "illuminance", "lx", (1,), rate_hz=2.0)) > 3600


def test_a_full_stream_loses_and_tells_how_many_and_leaves_others_alone():
    inbox = SampleQueue({"lux": 2, "camera": 2})
    assert [inbox.put(reading(n)) for n in range(5)] == [True, True, False, False, False]
    assert inbox.put(reading(9, "camera"))
    drain(inbox)
    assert inbox.put(reading(5))
    gap, sample = drain(inbox)
    assert isinstance(gap, Event)
    assert gap.kind is EventKind.GAP
    assert gap.data == {"lost": 3}
    assert isinstance(sample, Reading)
    assert Quality.DROPPED_BEFORE in sample.quality
    assert inbox.dropped == {"lux": 3}


def test_samples_pass_while_a_minute_is_estimated_and_time_is_held_until_it_is_processed():
    inbox, found = SampleQueue({"lux": 4}), Future[Minute]()
    inbox.put_when_done(found)
    inbox.put(reading(1))
    assert drain(inbox) == [reading(1)]
    assert inbox.is_busy()
    assert not inbox.is_settled(0.0)
    found.set_exception(ZeroDivisionError("no light"))
    assert drain(inbox) == [found]
    assert inbox.is_settled(0.0)
