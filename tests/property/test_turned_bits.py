"""A bit that turned over in a sealed session is named by `check`, or is none that anything is read from."""

import random
import re
from pathlib import Path

import pytest

from fieldkit.sessions.digests import NOT_YET
from fieldkit.sessions.layout import TIME_MAP_COLUMNS
from tests.harness.faults import Faults, failures, small_session

SLICES = 8
OTHERWISE = {*NOT_YET, *(f"time_map/{column.name}" for column in TIME_MAP_COLUMNS)}
"""Under no digest: the digests themselves, the session's state, and rows with a checksum of their own."""


@pytest.fixture(scope="module")
def faults(tmp_path_factory):
    return Faults(small_session(tmp_path_factory.mktemp("sealed") / "small.h5"))


def is_named_or_harmless(faults: Faults, place: int, bit: int, scratch: Path) -> bool:
    data = faults.flipped(place, bit)
    if faults.noticed(data, faults.near(place)):
        return True
    return bool(failures(scratch, data)) or faults.reads_the_same(data)


def test_a_bit_of_each_value_is_named(faults, tmp_path):
    chance = random.Random(1)
    assert len(faults.values) > 140
    asked = 0
    for span in faults.values:
        place, bit = chance.randrange(span.start, span.stop), chance.randrange(8)
        data = faults.flipped(place, bit)
        named = faults.noticed(data, span.dataset)
        if named != span.dataset or chance.random() < 0.02:
            asked += 1
            what = failures(tmp_path / "a.h5", data)
            assert what, f"bit {bit} of byte {place}, of {span.dataset}"
            assert not named or named in what
    assert asked > 5


def test_a_bit_of_each_structure_of_the_file_is_named(faults, tmp_path):
    """Object headers with the attributes, heaps and indexes: what HDF5 itself guards."""
    chance = random.Random(2)
    starts = [found.start() for found in re.finditer(b"OHDR|OCHK|FRHP|FHDB|BTHD|BTLF|EAHD|GCOL", faults.data)]
    assert len(starts) > 300
    for start in chance.sample(starts, 24):
        place = start + chance.randrange(5, 24)
        assert is_named_or_harmless(faults, place, chance.randrange(8), tmp_path / "a.h5"), place


def test_random_bits_of_the_file_are_named_or_harmless(faults, tmp_path):
    chance = random.Random(3)
    for _ in range(2):
        place, bit = chance.randrange(len(faults.data)), chance.randrange(8)
        assert is_named_or_harmless(faults, place, bit, tmp_path / "a.h5"), (place, bit)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(SLICES))
def test_every_bit_of_every_value_is_named(faults, part):
    spans = [span for span in faults.values if span.dataset not in OTHERWISE]
    for span in spans[part::SLICES]:
        for place in range(span.start, span.stop):
            for bit in range(8):
                named = faults.noticed(faults.flipped(place, bit), span.dataset)
                assert named == span.dataset, (place, bit)


@pytest.mark.slow
def test_every_tenth_bit_that_no_digest_covers_is_named(faults, tmp_path):
    for span in faults.values:
        if span.dataset in OTHERWISE:
            for number in range(0, 8 * (span.stop - span.start), 10 if span.stop - span.start < 999 else 500):
                place, bit = span.start + number // 8, number % 8
                assert failures(tmp_path / "a.h5", faults.flipped(place, bit)), (span.dataset, place, bit)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(SLICES))
def test_every_bit_that_hdf5_guards_is_named(faults, tmp_path, part):
    """Every bit of every byte that is part of something: the first bit of a byte tells whether it is."""
    values = {place for span in faults.values for place in range(span.start, span.stop)}
    rest = [place for place in range(len(faults.data)) if place not in values]
    guarded = [place for place in rest if faults.data[place]]
    for place in guarded[part * len(guarded) // SLICES : (part + 1) * len(guarded) // SLICES]:
        if faults.noticed(faults.flipped(place, 0), faults.near(place)):
            for bit in range(1, 8):
                assert faults.noticed(faults.flipped(place, bit)), (place, bit)
        else:
            assert is_named_or_harmless(faults, place, 0, tmp_path / "a.h5"), place


@pytest.mark.slow
def test_two_thousand_random_bits_are_named_or_harmless(faults, tmp_path):
    chance = random.Random(4)
    for _ in range(2000):
        place, bit = chance.randrange(len(faults.data)), chance.randrange(8)
        assert is_named_or_harmless(faults, place, bit, tmp_path / "a.h5"), (place, bit)
