"""A bit that turned over in a sealed session is named by `check`, or is none that anything is read from."""

import random
import re
from pathlib import Path

import pytest

from tests.harness.faults import Faults, failures, small_session


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


@pytest.mark.parametrize("trials", [2, pytest.param(2000, marks=pytest.mark.slow)])
def test_random_bits_of_the_file_are_named_or_harmless(faults, tmp_path, trials):
    chance = random.Random(3)
    for _ in range(trials):
        place, bit = chance.randrange(len(faults.data)), chance.randrange(8)
        assert is_named_or_harmless(faults, place, bit, tmp_path / "a.h5"), (place, bit)
