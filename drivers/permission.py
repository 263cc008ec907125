"""What to type when an instrument may not be opened."""

from __future__ import annotations

import grp
import os

UDEV_FIX = "fieldkit doctor --udev | sudo tee /etc/udev/rules.d/70-fieldkit.rules"


def permission_fix(group: str) -> str:
    """What to type when a node may not be opened; nobody should join the group root for it."""
    rules = f"{UDEV_FIX}, then unplug and plug it"
    return rules if group == "root" else f"{rules}; or: sudo usermod -aG {group} $USER, then log in again"


def group_of(path: str) -> str:
    """The group that a node belongs to; where that cannot be told, the one most systems use."""
    try:
        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
