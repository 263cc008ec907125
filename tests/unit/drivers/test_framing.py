"""Stamps of records by when their chunks were read, on computers that keep up and on those that do not.

Expected times follow from ten bits a byte at 9600 baud, 1.0417 ms, and the Lutron's record of 16 bytes.
"""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldkit.drivers.framing import Framer, Line
from fieldkit.drivers.meters import text
from fieldkit.drivers.meters.lutron import LAYOUT
from fieldkit.model.clock import HostClock

RECORD = bytes.fromhex("02 34 31 31 35 30 30 30 30 30 39 38 37 36 30 0D")
BYTE_NS = Line(9600).byte_ns
MS = 1_000_000


def stamps(chunks, layout=LAYOUT, byte_ns=BYTE_NS):
    """(begin in ms, bunched) of every record in chunks given as (read at ms, bytes)."""
    framer, found = Framer(byte_ns), []
    for read_ms, chunk in chunks:
        one = framer.feed(layout, chunk, round(read_ms * MS))
        while one is not None:
            found.append((one.mono_ns / MS, one.bunched))
            one = framer.next_record(layout)
    return found


def test_records_that_waited_in_the_port_keep_their_order_and_none_lies_in_the_future():
    """A record, then four queued 10 ms later; by the wire's time alone the second would begin at 943.3 ms."""
    found = stamps([(1000, RECORD), (1010, 4 * RECORD)])
    assert [begin for begin, _ in found] == pytest.approx([983.33, 1000.0, 1002.5, 1005.0, 1007.5], abs=0.01)
    assert [bunched for _, bunched in found] == [False, True, True, True, True]


def test_a_reader_that_slept_for_a_second_flags_what_waited_for_it():
    found = stamps([(0, RECORD), (1000, 3 * RECORD), (1100, RECORD)])
    assert [begin for begin, _ in found] == pytest.approx([-16.67, 950.0, 966.67, 983.33, 1083.33], abs=0.01)
    assert [bunched for _, bunched in found] == [False, True, True, True, False]


def test_one_late_reading_moves_no_later_stamp():
    """The line is never idle; the second chunk is read 9 ms late, the third on time."""
    found = stamps([(17, RECORD), (43, RECORD), (51, RECORD), (68, RECORD)])
    assert [begin for begin, _ in found] == pytest.approx([0.33, 26.33, 43.0, 51.33], abs=0.01)
    assert not any(bunched for _, bunched in found)


def test_a_record_in_two_chunks_begins_with_the_first_and_ends_with_the_second():
    found = stamps([(100, RECORD[:1]), (140, RECORD[1:] + RECORD), (145, RECORD)])
    assert [begin for begin, _ in found] == pytest.approx([98.96, 123.33, 140.0], abs=0.01)


def test_an_instrument_that_says_two_things_in_one_breath_has_not_waited():
    layout, byte_ns = text.Grammar().layout, text.LINE.byte_ns
    breath = b"T1=21.5 C\nlux=98760 lx\n"
    assert [bunched for _, bunched in stamps([(0, breath), (1000, breath)], layout, byte_ns)] == 4 * [False]


def test_lines_that_an_adapter_delivers_every_16_ms_have_not_waited():
    layout, byte_ns = text.Grammar().layout, text.LINE.byte_ns
    chunks = [(16 * number, 2 * b"T1=21.5 C\n") for number in range(1, 5)]
    assert not any(bunched for _, bunched in stamps(chunks, layout, byte_ns)[2:])


@given(
    st.lists(st.integers(0, 200 * MS), min_size=1, max_size=20),
    st.lists(st.integers(1, 80), min_size=20, max_size=20),
    st.booleans(),
)
def test_whatever_the_chunks_stamps_never_decrease_and_never_lie_in_the_future(waits, lengths, noisy):
    framer, now, place = Framer(BYTE_NS), HostClock().mono_ns(), 0
    wire = (RECORD + (b"\xff" if noisy else b"")) * 120
    found = []
    for wait, length in zip(waits, lengths, strict=False):
        now, chunk, place = now + wait, wire[place : place + length], place + length
        one = framer.feed(LAYOUT, chunk, now)
        while one is not None:
            assert one.mono_ns <= now
            found.append(one.mono_ns)
            one = framer.next_record(LAYOUT)
    assert all(later >= earlier for earlier, later in pairwise(found))
