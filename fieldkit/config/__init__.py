"""The configuration of a campaign, ``fieldkit.toml``: strict, with all mistakes reported at once.

`load_config` returns a `Config`, whose properties are the objects that other rooms use (`Site`, `Region`,
`DeviceSettings`, `EstimatorSettings`). Keys carry their unit in their name.
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
