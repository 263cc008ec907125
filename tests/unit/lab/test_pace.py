"""When isochronous packets go out, and how many wait in QEMU's queue while the guest takes none.

QEMU's queue by its source (hw/usb/redirect.c, 7.2): it holds packets of 60 ms before it gives the first away,
again whenever it ran dry, and from 120 ms on drops what comes.
"""

import numpy as np
import pytest
from usblab import pace
from usblab.models.ht301 import HT301
from usblab.models.purethermal import PureThermal


class Queue:
    """QEMU's: `put` a packet, `take` one in each service interval."""

    def __init__(self, target):
        self.target, self.level, self.flows, self.dropped = target, 0, False, 0

    def put(self):
        if self.level >= 2 * self.target:
            self.dropped += 1
        else:
            self.level += 1

    def take(self):
        self.flows = self.level > 0 and (self.flows or self.level >= self.target)
        self.level -= self.flows


CAMERAS = {
    # model, pictures a second, packets of a picture, seconds between packets, QEMU's target
    "purethermal": (lambda: PureThermal(lambda _: np.zeros((120, 160))), 9.0, 39, 1e-3, 60),
    "ht301": (lambda: HT301(lambda _: np.zeros((288, 384))), 25.0, 74, 5e-4, 480),
}


def played(kind, seconds, stalls, monkeypatch):
    """A stream of so many seconds; the guest takes nothing within `stalls`, pairs of begin and end."""
    make, rate_hz, packets, interval_s, target = CAMERAS[kind]
    now = 0.0
    monkeypatch.setattr(pace.time, "monotonic", lambda: now)  # stalls at exact times
    paced, queue = pace.IsoPace(make(), 10), Queue(target)
    waiting, sent, due_s = 0, 0, 1.0 / rate_hz
    for step in range(round(seconds / interval_s)):
        now = step * interval_s
        if now >= due_s:
            waiting, due_s = waiting + packets, due_s + 1.0 / rate_hz
        for _ in range(paced.owed(now)):
            if paced.carries_a_packet(waiting > 0):
                queue.put()
                sent += waiting > 0
                waiting -= waiting > 0
        if not any(begin <= now < end for begin, end in stalls):
            queue.take()
    return queue, sent, waiting


@pytest.mark.parametrize("kind", list(CAMERAS))
def test_all_data_go_out_and_the_queue_runs_dry(kind, monkeypatch):
    queue, sent, waiting = played(kind, 4.0, [], monkeypatch)
    _, rate_hz, packets, _, target = CAMERAS[kind]
    assert sent + waiting >= packets * (4.0 * rate_hz - 1.01)
    assert waiting <= packets
    assert queue.level <= target + 1
    assert queue.dropped == 0


@pytest.mark.parametrize(("kind", "stall_s", "every_s"), [("purethermal", 0.15, 0.7), ("ht301", 0.2, 5.0)])
def test_a_guest_that_gets_no_processor_for_a_while_again_and_again_loses_nothing(
    kind, stall_s, every_s, monkeypatch
):
    stalls = [(number * every_s, number * every_s + stall_s) for number in range(1, 30)]
    queue, _, _ = played(kind, 20.0, stalls, monkeypatch)
    assert queue.dropped == 0


def test_what_was_not_sent_in_time_is_not_made_up_for(monkeypatch):
    now = 0.0
    monkeypatch.setattr(pace.time, "monotonic", lambda: now)  # stalls at exact times
    paced = pace.IsoPace(PureThermal(lambda _: np.zeros((120, 160))), 10)
    assert paced.owed(0.010) == 10
    assert paced.owed(0.300) == 10
    assert paced.owed(0.305) == 0
    assert paced.owed(0.311) == 10
