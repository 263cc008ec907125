"""What is not read says what it is, and what to save instead."""

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.results.importing import ImportOptions, read_source
from fieldkit.sessions.formats import bags, containers, frame_tables, stills
from fieldkit.sessions.formats.unread import UNREAD
from tests.harness.next_steps import at

PEOPLE_HAVE = ".is2 .bmt .ravi .irb .sqlite .tob1 .mp4 .zip .json .npy .hobo .docx .db3"


@pytest.mark.parametrize("suffix", PEOPLE_HAVE.split())
def test_a_known_ending_is_named_with_what_to_save_instead(tmp_path, suffix):
    path = tmp_path / f"a{suffix.upper()}"
    path.write_bytes(b"\0\1\2")
    with pytest.raises(ConfigError, check=at(path)) as caught:
        read_source(path, ImportOptions())
    assert (caught.value.message.endswith(UNREAD[suffix][0]), caught.value.fix) == (True, UNREAD[suffix][1])


def test_binary_tables_of_campbell_are_known_by_their_first_word(tmp_path):
    path = tmp_path / "CR1000_Table.dat"
    path.write_bytes(b'"TOB1","CR1000","1234"\r\n"SECONDS","NANOSECONDS","T_C"\r\n\x87\xe2\xfe')
    with pytest.raises(ConfigError, check=at(path)) as caught:
        read_source(path, ImportOptions())
    assert caught.value.fix == UNREAD[".tob1"][1]


def test_no_ending_is_both_read_and_not_read():
    read = {*stills.SUFFIXES, *frame_tables.SUFFIXES, *bags.SUFFIXES, *containers._READERS}
    assert not read & set(UNREAD)
