"""How fieldkit is installed: the name for every message that names an installation, and its origin."""

from __future__ import annotations

from pathlib import Path

DISTRIBUTION = "fieldkit-slope"
"""Name in package indexes, where ``fieldkit`` is another project."""


def install_extra(extra: str) -> str:
    """Command that installs the libraries of an extra, such as ``lab``."""
    return f"pip install '{DISTRIBUTION}[{extra}]'"


PACKAGE = Path(__file__).resolve().parents[1]
STAMP = PACKAGE / "commit.txt"
"""Written by ``packaging/hatch_build.py`` into wheels and source archives; a checkout has none."""


def origin() -> str:
    """Commit and source of the running program in one line, such as ``commit 1f0c3a5e77d2, wheel NAME``."""
    if STAMP.exists():
        return f"commit {STAMP.read_text(encoding='utf-8').strip()}, {_installation_source()}"
    checkout = PACKAGE.parent
    if (checkout / ".git").exists():
        return f"commit {_commit_of(checkout)}, checkout {checkout}"
    return f"commit unknown, {_installation_source()}"


def _commit_of(checkout: Path) -> str:
    """The commit that is checked out, with ``-dirty`` if files were changed since."""
    import subprocess

    words = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):  # no git, or a checkout of another user
        return "unknown"


def _installation_source() -> str:
    """The distribution installed, as the installer recorded it (PEP 610, PEP 627)."""
    import json
    from importlib.metadata import PackageNotFoundError, distribution  # 20 ms

    try:
        installed = distribution(DISTRIBUTION)
    except PackageNotFoundError:
        return f"source {PACKAGE.parent}"
    recorded = installed.read_text("direct_url.json")  # none if it came from an index
    installer = (installed.read_text("INSTALLER") or "an unknown installer").strip()
    if not recorded:
        return "Debian package" if installer == "dpkg" else f"installed by {installer} from a package index"
    url = str(json.loads(recorded)["url"])
    kind = "wheel" if url.endswith(".whl") else "source"
    return f"{kind} {url.removeprefix('file://')}"
