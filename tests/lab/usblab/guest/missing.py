"""Why the lab cannot run on this computer."""

from __future__ import annotations

from pathlib import Path


class MissingPartError(RuntimeError):
    """A program or package that the guest is made from is missing; the text names it and what to type."""


INSTALL = f"bash {Path(__file__).resolve().parents[1] / 'install.sh'}"
