"""An exception in a notebook shows what to do next; a message that quotes it does not repeat that."""

import pickle

from fieldkit.model.errors import ConfigError, DeviceTimeoutError, message_of


def test_text_of_an_error_carries_the_fix():
    error = ConfigError("no fieldkit.toml in /tmp", fix="fieldkit init")
    assert str(error) == "no fieldkit.toml in /tmp\n  fix: fieldkit.init_campaign(folder)"
    assert str(DeviceTimeoutError("nothing arrived")) == "nothing arrived"


def test_quoted_error_is_its_message_alone():
    assert message_of(ConfigError("no fieldkit.toml", fix="fieldkit init")) == "no fieldkit.toml"
    assert message_of(ValueError("plain")) == "plain"


def test_fix_survives_the_way_between_processes():
    again = pickle.loads(pickle.dumps(ConfigError("a key is wrong", fix="remove it")))
    assert (again.message, again.fix) == ("a key is wrong", "remove it")
