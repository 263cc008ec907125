"""The rights of an ordinary user, in tests that root may run."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ordinary_rights() -> Iterator[None]:
    """What the mode of a file or folder forbids is refused, in this thread and those that begin here.

    Root passes over modes by capabilities (capabilities(7)), which a thread may put down and take up again.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # _LINUX_CAPABILITY_VERSION_3, this thread
    held = (ctypes.c_uint32 * 6)()  # twice: effective, permitted, inheritable
    assert libc.capget(header, held) == 0
    lowered = type(held)(0, *held[1:3], 0, *held[4:])
    assert libc.capset(header, lowered) == 0
    try:
        yield
    finally:
        assert libc.capset(header, held) == 0
