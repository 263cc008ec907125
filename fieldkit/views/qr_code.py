"""An address as a QR code in a terminal, to be photographed by a phone; needs ``fieldkit-slope[page]``."""

from __future__ import annotations

from io import StringIO

WHITE_ON_BLACK, PLAIN = "\x1b[38;5;231;48;5;16m", "\x1b[0m"
"""Fixed colours of the 256-colour cube: many phones do not read a code in a light theme's inverse colours."""


def qr_lines(text: str) -> list[str]:
    """Lines of half blocks that show `text` as a QR code, the same on dark and light themes.

    An address with a key of 128 bits takes 19 lines of 37 characters, quiet zone included. Raises
    `ImportError` without the library of ``fieldkit-slope[page]``.
    """
    import segno

    drawn = StringIO()
    segno.make_qr(text).terminal(drawn, compact=True)
    return [f"{WHITE_ON_BLACK}{line}{PLAIN}" for line in drawn.getvalue().splitlines()]
