"""An exception in a notebook shows what to do next; a message that quotes it does not repeat that."""

import pickle
from pathlib import Path

from fieldkit.model.errors import ConfigError, DeviceTimeoutError, IncompleteError, message_of
from fieldkit.model.next_step import Action, Argument


def test_text_of_an_error_carries_the_fix():
    error = ConfigError("holds counts", place=Path("a.tiff"), fix="omit " + Argument("unit"))
    assert str(error).split("\n  fix: ") == ["a.tiff: holds counts", "omit unit"]
    assert str(error.line) == "; ".join(["a.tiff: holds counts", "omit unit"])
    assert str(DeviceTimeoutError("nothing arrived")) == "nothing arrived"
    assert str(Action.LIST_SESSIONS()) == "fieldkit.open_campaign().sessions"


def test_quoted_error_is_its_message_alone():
    assert message_of(ConfigError("no campaign", fix="create one")) == "no campaign"
    assert message_of(ValueError("plain")) == "plain"


def test_fix_survives_the_way_between_processes():
    again = pickle.loads(pickle.dumps(ConfigError("wrong", place="key", fix=Action.DOCTOR())))
    assert (again.place, again.message, again.fix) == ("key", "key: wrong", Action.DOCTOR())
    files = (Path("a.csv"),)
    assert pickle.loads(pickle.dumps(IncompleteError("b", files))).files == files
