import re

import cv2
import numpy as np
import pytest

from fieldkit.cli.page import qr_lines

ADDRESS = "http://192.168.4.20:8420/#pQ8x0Zt3V7cJm2LkYw9RbA"
# upper and lower half of a character cell: whether the foreground colour covers it (Unicode, block elements)
HALVES = {" ": (0, 0), "\u2580": (1, 0), "\u2584": (0, 1), "\u2588": (1, 1)}
CUBE = {"16": 0, "231": 255}  # black and white of xterm's 256 colours, which no theme changes


@pytest.mark.parametrize("background", [0, 255], ids=["dark theme", "light theme"])
def test_a_phone_reads_the_address_from_the_terminal(background):
    found, _, _ = cv2.QRCodeDetector().detectAndDecode(_screenshot(qr_lines(ADDRESS), background))
    assert found == ADDRESS


def _screenshot(lines: list[str], background: int) -> np.ndarray:
    """The terminal as an image: cells of 8 x 16 pixels, in the theme's background."""
    rows = np.vstack([_modules(line) for line in lines]) * 255
    return np.pad(np.kron(rows, np.ones((8, 8))), 40, constant_values=background).astype(np.uint8)


def _modules(line: str) -> np.ndarray:
    """Two rows of modules, 1 for light, in the colours that the line sets."""
    light, dark = (CUBE[number] // 255 for number in re.findall(r"[34]8;5;(\d+)", line))
    halves = np.array([HALVES[character] for character in re.sub(r"\x1b\[[\d;]*m", "", line)]).T
    return np.where(halves, light, dark)
