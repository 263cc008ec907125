"""Pictures cut into payloads: a header, then pixels."""

from __future__ import annotations

FRAME_ID, END_OF_FRAME, ERROR, END_OF_HEADER = 0x01, 0x02, 0x40, 0x80
HEADER_BYTES = 2


def header(toggle: bool, end: bool) -> bytes:
    """The two-byte header: frame id, which toggles with each picture, and end of frame."""
    return bytes((HEADER_BYTES, END_OF_HEADER | (FRAME_ID if toggle else 0) | (END_OF_FRAME if end else 0)))


def bulk(picture: bytes, toggle: bool) -> bytes:
    """One picture as one payload; it ends with a short transfer or at the committed payload size."""
    return header(toggle, end=True) + picture


def packets(picture: bytes, toggle: bool, packet_bytes: int) -> list[bytes]:
    """One picture as isochronous packets, each with its own header."""
    room = packet_bytes - HEADER_BYTES
    pieces = [picture[start : start + room] for start in range(0, len(picture), room)]
    return [header(toggle, end=number == len(pieces)) + piece for number, piece in enumerate(pieces, 1)]
