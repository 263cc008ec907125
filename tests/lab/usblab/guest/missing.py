"""Why the lab cannot run on this computer."""

from __future__ import annotations


class MissingPartError(RuntimeError):
    """A program or package the guest is made from is not here; the text says which and what to type."""


INSTALL = "bash tests/lab/install.sh"
