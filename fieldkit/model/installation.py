"""The name under which fieldkit is installed, for every message that names an installation."""

DISTRIBUTION = "fieldkit-slope"
"""Name in package indexes, where ``fieldkit`` is another project."""


def install_extra(extra: str) -> str:
    """Command that installs the libraries of an extra, such as ``lab``."""
    return f"pip install '{DISTRIBUTION}[{extra}]'"
