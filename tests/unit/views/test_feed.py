"""The feed passes a recording on to readers and never waits for them."""

import math
import stat
import time

import numpy as np
import pytest

from fieldkit.estimation.estimator import Minute
from fieldkit.model.device import StreamInfo
from fieldkit.model.samples import Event, EventKind, Frame, Health, Quality, Reading, Severity, StreamHealth
from fieldkit.model.site import Region, RegionKind, Site
from fieldkit.model.slope import SlopeEstimate, SlopeState
from fieldkit.views.feed import Feed, FeedReader, FeedStart, decode, encode
from fieldkit.views.latest import Latest, Trend
from fieldkit.views.unix_socket import LENGTHS

SITE = Site(37.7, -105.92, 2317.0, "America/Denver")
REGIONS = (Region("flat", RegionKind.REFERENCE, ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0)), 0.0, 0.0),)
STREAMS = (
    StreamInfo("camera", "brightness_temperature", "K", (120, 160), 0.01, settings={"gain": "high"}),
    StreamInfo("lux", "illuminance", "lx", (1,)),
)
EVENT = Event(EventKind.MARK, 5, 6, "hello", data={"label": "cloud", "end_ns": 8}, severity=Severity.WARNING)
READING = Reading("lux", 3, 4, (98_000.0, math.nan), b"\x02D\r", Quality.STALE, seq=7)
HEALTH = Health(1, 2, (StreamHealth("camera", 9, 1, 0),), 10**9, 500)


def frame(number: int, shape: tuple[int, int] = (120, 160)) -> Frame:
    counts = np.random.default_rng(number).integers(0, 65_536, shape, dtype=np.uint16)
    return Frame("camera", number, number + 1, counts, counts[:2], Quality.SHUTTER, seq=number)


def minute(number: int) -> Minute:
    slope = SlopeEstimate(number, "b15", SlopeState.OK, 15.0 + number, 180.0)
    means = {"flat": 300.0, "b15": 301.0 + number}
    return Minute(
        number, (slope,), means, {}, {}, 1e5, 900.0, "eq10", 60.0, 180.0, (281.0,), Quality.GOOD, (EVENT,)
    )


@pytest.fixture
def path(tmp_path):
    return tmp_path / "feed"


@pytest.fixture
def feed(path):
    feed = Feed(path, Latest(SITE, REGIONS, STREAMS, "day", 10**18), "{{}}".format)
    yield feed
    feed.close()


def same(one: object, other: object) -> bool:
    return repr(one) == repr(other)  # in which NaN is equal to NaN


@pytest.mark.parametrize(
    "item", [EVENT, READING, HEALTH, minute(1), Trend([1], [True], {"tilt_deg": {"a": [math.nan]}})]
)
def test_items_come_out_as_they_went_in(item):
    message = encode(item)
    header, body = LENGTHS.unpack(message[: LENGTHS.size])
    assert (header + body, body) == (len(message) - LENGTHS.size, 0)
    assert same(decode(message[LENGTHS.size :], b""), item)


def test_frames_come_out_as_they_went_in():
    sent = frame(1)
    message = encode(sent)
    header, _ = LENGTHS.unpack(message[: LENGTHS.size])
    split = LENGTHS.size + header
    found = decode(message[LENGTHS.size : split], message[split:])
    np.testing.assert_array_equal(found.counts, sent.counts)
    np.testing.assert_array_equal(found.metadata_rows, sent.metadata_rows)
    assert same(found._replace(counts=0, metadata_rows=0), sent._replace(counts=0, metadata_rows=0))


@pytest.mark.parametrize("header", [b"", b"3", b'["Frame", {}]', b'["Event", 3]', b'["object", {}]', b"\xff"])
def test_other_bytes_are_refused(header):
    with pytest.raises(ValueError, match="feed"):
        decode(header, b"abc")


def test_a_reader_receives_what_is_known_and_then_what_comes(feed, path):
    for item in (frame(1), READING, EVENT, HEALTH, minute(1), minute(2)):
        feed.show(item)
    items = FeedReader(path).items()
    start, trend = next(items), next(items)
    assert same(start, FeedStart(SITE, REGIONS, STREAMS, "day", 10**18, 2))
    assert trend.times_ns == [1, 2]
    assert trend.columns["tilt_deg"] == {"b15": [16.0, 17.0]}
    known = {type(next(items)).__name__ for _ in range(5)}
    assert known == {"Frame", "Reading", "Event", "Health", "Minute"}
    feed.show(EVENT)
    assert same(next(items), EVENT)
    feed.close()
    assert list(items) == []


def test_a_minute_counts_once_in_the_trend_although_a_reader_receives_it_twice():
    latest = Latest(SITE, REGIONS, STREAMS)
    for item in (minute(1), minute(2), minute(2)):
        latest.update(item)
    assert (latest.trend.times_ns, latest.trend.columns["tilt_deg"]) == ([1, 2], {"b15": [16.0, 17.0]})


def test_only_this_user_can_open_it(feed, path):
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_long_path_is_no_obstacle(tmp_path):
    folder = tmp_path / ("a" * 200) / "20261211T025512Z-long.h5.journal"  # a socket's address holds 107 bytes
    folder.mkdir(parents=True)
    feed = Feed(folder / "feed", Latest(SITE, REGIONS, STREAMS), "{{}}".format)
    assert isinstance(next(FeedReader(folder / "feed").items()), FeedStart)
    feed.close()


def test_a_reader_that_does_not_read_loses_frames_and_delays_nothing(feed, path):
    reader = FeedReader(path)
    frames = [frame(number, (512, 640)) for number in range(1, 10)]
    began = time.monotonic()
    for _ in range(30):
        for one in frames:
            feed.show(one)  # 270 frames of 655 kB: far more than a socket holds
    feed.show(EVENT)
    assert time.monotonic() - began < 1.0
    items = iter(reader.items())
    received = []
    while not isinstance(item := next(items), Event):
        received.append(item)
    assert sum(isinstance(item, Frame) for item in received) < 30
