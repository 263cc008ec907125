"""The configuration of a campaign, ``fieldkit.toml``: strict, with all mistakes reported at once.

`load_config` returns a `Config`, whose properties are the objects that other rooms use (`Site`, `Region`,
`DeviceSettings`, `EstimatorSettings`). Keys carry their unit in their name.

What reads the file is imported when it is used: some commands only find the campaign.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from fieldkit.config.files import FILE_NAME as FILE_NAME
from fieldkit.config.files import NoCampaignError as NoCampaignError
from fieldkit.config.files import find_campaign as find_campaign

if TYPE_CHECKING:
    from fieldkit.config.config import Config as Config
    from fieldkit.config.load import changed_config as changed_config
    from fieldkit.config.load import config_from_text as config_from_text
    from fieldkit.config.load import load_config as load_config
    from fieldkit.config.load import mistakes_in as mistakes_in
    from fieldkit.config.load import read_config as read_config
    from fieldkit.config.validation import ConfigMistakesError as ConfigMistakesError
    from fieldkit.config.validation import Mistake as Mistake

_LOADING = ("changed_config", "config_from_text", "load_config", "mistakes_in", "read_config")
_HOMES = dict.fromkeys(_LOADING, "load")
_HOMES |= {"Config": "config", "ConfigMistakesError": "validation", "Mistake": "validation"}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
