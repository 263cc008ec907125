"""fieldkit: terrain slope from surface temperature, from instruments to report.

``open_session(path)`` opens a recording, ``open_campaign(path)`` a campaign with its sessions.
Nothing heavy is imported before it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fieldkit.sessions.reader import open_session as open_session
    from fieldkit.workflows.campaign import open_campaign as open_campaign

__version__ = "0.1.0"
__all__ = ["__version__", "open_campaign", "open_session"]


def __getattr__(name: str) -> Any:
    if name == "open_campaign":
        from fieldkit.workflows.campaign import open_campaign

        return open_campaign
    if name == "open_session":
        from fieldkit.sessions.reader import open_session

        return open_session
    raise AttributeError(f"module 'fieldkit' has no attribute {name!r}")
