"""Why a command that the page ran failed."""

from __future__ import annotations

import json

from fieldkit.model.errors import RefusedError


def command_error(printed: str, otherwise: str) -> RefusedError:
    """The error that a command with ``--json`` left on stderr as its last line; `otherwise` without one."""
    try:
        document = json.loads(printed.splitlines()[-1])
        return RefusedError(document["error"], fix=document["fix"])
    except (ValueError, LookupError, TypeError):  # killed, or an option of another version
        return RefusedError(otherwise, fix="run the command in a terminal, which shows why")
