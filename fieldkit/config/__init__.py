"""The configuration of a campaign, ``fieldkit.toml``: strict, with all mistakes reported at once.

`load_config` returns a `Config`, whose properties are the objects that other rooms use (`Site`, `Region`,
`DeviceSettings`, `EstimatorSettings`). Keys carry their unit in their name.

What reads the file is imported when it is used: some commands only find the campaign.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from fieldkit.config.files import FILE_NAME, NoCampaignError, find_campaign

if TYPE_CHECKING:
    from fieldkit.config.config import Config
    from fieldkit.config.load import (
        changed_config,
        config_from_text,
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
    "NoCampaignError",
    "changed_config",
    "config_from_text",
    "find_campaign",
    "load_config",
    "mistakes_in",
    "read_config",
    "user_file",
]

_HOMES = {"Config": "config", "ConfigMistakesError": "validation", "Mistake": "validation"}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES.get(name, 'load')}"), name)
