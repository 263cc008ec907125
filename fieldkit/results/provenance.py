"""Provenance of a result: the command typed, the code, its libraries, the sessions by content."""

from __future__ import annotations

import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from fieldkit.model.errors import FieldkitError
from fieldkit.results.cache import PACKAGES, code_version
from fieldkit.results.sources import Source


def command_line() -> str:
    """The ``fieldkit`` command that is running, as it was typed; empty if another program calls fieldkit.

    The arguments of a notebook's kernel or of a user's script are not ours to record.
    """
    program = Path(sys.argv[0])
    is_fieldkit = program.stem == "fieldkit" or program.parts[-2:] == ("fieldkit", "__main__.py")
    return shlex.join(["fieldkit", *sys.argv[1:]]) if is_fieldkit else ""


def provenance(sources: Sequence[Source], failures: Mapping[Path, FieldkitError]) -> dict[str, Any]:
    """Provenance of a result: command, code, libraries, sessions by content. No dates, so it repeats."""
    return {
        "command_line": command_line(),
        "code_version": code_version(),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "packages": {name: metadata.version(name) for name in PACKAGES},
        "sessions": [
            {"path": str(source.path), "sha256": source.checksum, "session_id": source.session_id}
            for source in sources
        ],
        "problems": [{"path": str(path), "problem": error.message} for path, error in failures.items()],
    }
