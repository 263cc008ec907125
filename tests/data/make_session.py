"""Writes the session that every later version must read: ``python -m tests.data.make_session``.

Done once for each minor version of the format; what is checked in is never written again.
"""

from pathlib import Path

from fieldkit.sessions.layout import FORMAT_VERSION
from tests.harness.faults import small_session

if __name__ == "__main__":
    small_session(Path(__file__).parent / "sessions" / f"{FORMAT_VERSION}.h5")
