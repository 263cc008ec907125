"""Conditions on rows: what they choose, and that nothing else is read as one."""

import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.model.next_step import Argument
from fieldkit.model.row_filter import LONGEST, row_filter

COLUMNS = {"region": str, "state": str, "tilt_deg": float, "true_tilt_deg": float}
ROWS = [
    {"region": "b05", "state": "ok", "tilt_deg": 5.2, "true_tilt_deg": 5.0},
    {"region": "b25", "state": "ok", "tilt_deg": 24.1, "true_tilt_deg": 25.0},
    {"region": "wall", "state": "wide", "tilt_deg": 61.0, "true_tilt_deg": None},
    {"region": "", "state": "", "tilt_deg": None, "true_tilt_deg": None},
]


@pytest.mark.parametrize(
    ("condition", "regions"),
    [
        ('tilt > 10 and state == "ok"', ["b25"]),
        ("tilt_deg > 10", ["b25", "wall"]),
        ("5 <= tilt < 30", ["b05", "b25"]),
        ("tilt < true_tilt", ["b25"]),
        ("not state == 'ok' or tilt < 6", ["b05", "wall", ""]),
        ("tilt > -1e3", ["b05", "b25", "wall"]),
        (" state != 'ok' ", ["wall", ""]),
        ("region >= 'b1' and (state == 'wide' or true_tilt == 25)", ["b25", "wall"]),
    ],
)
def test_rows_that_meet_a_condition(condition, regions):
    is_met = row_filter(condition, COLUMNS)
    assert [row["region"] for row in ROWS if is_met(row)] == regions


@pytest.mark.parametrize(
    "condition",
    [
        *("", "tilt", "tilt >", "tilt = 5", "tilt > 5; state", "True", "tilt > True", "tilt > None"),
        *("tilz > 5", "tilt > 'ten'", "state > 5", "tilt + 1 > 5", "-tilt > 5", "tilt is 5", "tilt > 1\0"),
        *("__import__('os').system('true') == 0", "tilt.real > 5", "tilt[0] > 5", "(lambda: 1)() == 1"),
        "tilt in (5, 6)",
        *("f'{tilt}' == 'a'", "[x for x in (1,)] == 1", "(tilt := 5) > 1", "'\\d' == 5", "tilt > 5j"),
        *(
            "tilt in (5, 6)",
            "(" * 600 + "tilt > 5" + ")" * 390,
            "not " * 249 + "tilt",
            "tilt > 5 or " * LONGEST,
        ),
    ],
)
def test_anything_else_is_refused_with_the_columns(condition):
    with pytest.raises(ConfigError) as error:
        row_filter(condition, COLUMNS)
    assert error.value.place == Argument("where", condition[:LONGEST])
    assert all(column in str(error.value.fix) for column in COLUMNS)
