"""What cannot be given to a calibration."""

import math

import numpy as np
import pytest

from fieldkit.calibration.ranges import LONGEST_NAME, RANGES, Range, require_name, require_ranges
from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from tests.harness.next_steps import at


@pytest.mark.parametrize("value", [0.0, 1, np.float32(0.5), np.int64(1)])
def test_numbers_of_a_range_are_in_it_whatever_their_type(value):
    assert value in Range(0.0, 1.0)


@pytest.mark.parametrize("value", [-0.1, 1.1, math.nan, math.inf, True, "0.5", None])
def test_what_is_beyond_a_range_or_not_a_number_is_not_in_it(value):
    assert value not in Range(0.0, 1.0)


def test_an_end_may_be_excluded():
    assert [end in Range(0.0, 1.0, above=True, below=True) for end in (0.0, 0.5, 1.0)] == [False, True, False]
    assert math.inf not in Range(0.0)


def test_what_is_not_given_is_not_refused_and_the_refusal_says_what_can_be_given():
    require_ranges({"hfov_deg": None, "region": "flat"})
    with pytest.raises(ConfigError, check=at(Argument("hfov_deg", 180))) as refused:
        require_ranges({"hfov_deg": 180})
    assert RANGES["hfov_deg"].words in str(refused.value.fix)


@pytest.mark.parametrize("name", ["", "a/b", "../../x", "a b", "-a", "a\0b", "x" * (LONGEST_NAME + 1)])
def test_what_cannot_be_part_of_a_files_name_cannot_name_a_record(name):
    with pytest.raises(ConfigError, check=lambda error: str(error.place).startswith(repr(name)[:20])):
        require_name(name)


@pytest.mark.parametrize("name", ["dry-silica-sand", "sand_2.5+", "\u7802-\u00e9t\u00e9"])
def test_letters_of_any_language_name_a_record(name):
    require_name(name)
