"""Limit on what a compressed file may unpack to, before it counts as damaged or made to fill the disk."""

from __future__ import annotations

from pathlib import Path

from fieldkit.model.errors import ConfigError

_ALWAYS_BYTES, _MOST_TIMES = 100_000_000, 100  # the noise of a sensor packs to a third or so


def refuse_bomb(path: Path, unpacked_bytes: int) -> None:
    """Raise `ConfigError` where a file unpacks to more than frames or tables of its size can."""
    size = path.stat().st_size
    if unpacked_bytes > _ALWAYS_BYTES + _MOST_TIMES * size:
        raise ConfigError(
            f"{path} of {size / 1e6:.1f} MB unpacks to {unpacked_bytes / 1e6:.0f} MB or more",
            fix="check where it comes from, and copy it again",
        )
