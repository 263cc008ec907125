"""When a trigger acts: once, when its condition has lasted, and again only after it was over."""

import math

import pytest

from fieldkit.model.samples import EventKind, Frame, Reading
from fieldkit.recorder.triggers import Trigger, Triggers


def acts(trigger: Trigger, values: list[float], *, waits: bool, rearmed: bool = False) -> list[int]:
    """The seconds in which it acts, on a channel that has these values, one a second."""
    ended: list[int] = []
    triggers = Triggers([trigger])
    triggers.end = None if waits else lambda: ended.append(1)
    if rearmed:
        triggers.rearm()
    seconds = []
    for second, value in enumerate(values):
        triggers.show(Reading("lux", second * 10**9, second * 10**9, (0.0, value)))
        triggers.show(Reading("other", second * 10**9, second * 10**9, (1e9, 1e9)))
        seconds += [event.time_ns // 10**9 for event in triggers.events()]
    assert (triggers.started is trigger) == (waits and bool(seconds))
    assert bool(ended) == (trigger.act == "stop" and bool(seconds))
    return seconds


HIGH = {"stream": "lux", "channel": 1, "high": 10.0}


@pytest.mark.parametrize(
    ("act", "more", "values", "waits", "seconds"),
    [
        ("mark", {}, [0, 11, 12, 0, 13], False, [1, 4]),
        ("mark", {}, [11, 11, 0, 11], False, [3]),  # the case from the beginning
        ("mark", {"hold_s": 2.0}, [0, 11, 11, 0, 11, 11, 11], False, [6]),
        ("mark", {}, [0, math.nan, 11], False, [2]),
        ("mark", {"hold_s": 2.0}, [0, 11, math.nan, 11], False, [3]),  # no value ends no condition
        ("mark", {"low": 5.0}, [7, 4, 7, 11], False, [1, 3]),  # outside both
        ("mark", {}, [0, 10.0, 0], False, []),
        ("mark", {}, [0, 11], True, []),  # what only waits is not marked
        ("start", {}, [11, 11], True, [0]),  # and a start may be the case already
        ("start", {"hold_s": 3.0}, [11, 11, 11, 11, 11], True, [3]),
        ("start", {}, [0, 11], False, []),
        ("stop", {}, [0, 11], False, [1]),
        ("stop", {}, [0, 11], True, []),
    ],
)
def test_a_condition_acts_once_when_it_has_lasted(act, more, values, waits, seconds):
    assert acts(Trigger("x", act, **{**HIGH, **more}), values, waits=waits) == seconds


def test_the_next_start_is_one_after_its_condition_was_over():
    start = Trigger("x", "start", **HIGH)
    assert acts(start, [11, 11], waits=True, rearmed=True) == []
    assert acts(start, [11, 0, 11], waits=True, rearmed=True) == [2]


def test_what_acted_is_a_mark_of_the_moment():
    triggers = Triggers([Trigger("bright", "start", **HIGH, text="lux:b above 10 lx")])
    triggers.show(Reading("lux", 5, 7, (0.0, 11.0)))
    (event,) = triggers.events()
    assert (event.kind, event.mono_ns, event.time_ns) == (EventKind.MARK, 5, 7)
    assert event.data == {"label": "trigger", "trigger": "bright", "act": "start"}
    assert list(triggers.events()) == []
    triggers.show(Frame("lux", 0, 0, None, None))  # of a camera: nothing
