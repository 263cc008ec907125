"""The configuration of a campaign: ``fieldkit.toml``, strict, with every mistake told at once.

`load_config` gives a `Config`, whose accessors speak the language of the other rooms (`Site`,
`Region`, `DeviceSettings`, `EstimatorSettings`). Keys carry their unit in their name.
"""

from fieldkit.config.config import Config
from fieldkit.config.load import (
    FILE_NAME,
    changed_config,
    config_from_text,
    find_campaign,
    load_config,
    mistakes_in,
    read_config,
    user_file,
)
from fieldkit.config.validation import ConfigMistakesError, Mistake

__all__ = [
    "FILE_NAME",
    "Config",
    "ConfigMistakesError",
    "Mistake",
    "changed_config",
    "config_from_text",
    "find_campaign",
    "load_config",
    "mistakes_in",
    "read_config",
    "user_file",
]
