import tomllib
from pathlib import Path

import pytest

from fieldkit.drivers import registry

GOLDEN = tomllib.loads((Path(__file__).parents[2] / "data/golden_records.toml").read_text())["record"]


def bytes_of(golden):
    return golden["text"].encode() if "text" in golden else bytes.fromhex(golden["hex"])


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden["id"])
def test_bytes_mean_what_the_maker_says(golden):
    decoded = registry.get(golden["driver"]).decode(bytes_of(golden), golden.get("options", {}))
    assert not decoded.rejected
    assert list(decoded.notes) == golden.get("notes", list(decoded.notes))
    assert decoded.rest == 0
    for value, expected in zip(decoded.values, golden["values"], strict=True):
        assert [value.unit, value.channel, value.flags] == [
            expected[key] for key in ("unit", "channel", "flags")
        ]
        assert value.value == pytest.approx(expected["value"], rel=1e-9, nan_ok=True)


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden["id"])
def test_a_record_is_found_again_after_noise_and_its_beginning_is_waited_for(golden):
    data = bytes_of(golden)
    # lines are parted by their end alone
    noise = b"\xfe\xfd\xfc" + b"\n" * (golden["driver"] in ("text", "gpsd"))
    decoded = registry.get(golden["driver"]).decode(noise + data + data[:5], golden.get("options", {}))
    assert len(decoded.values) == len(golden["values"])
    assert [(part.offset, part.length) for part in decoded.rejected] == [(0, len(noise))]
    assert decoded.rest == 5


BROKEN = [
    *(("lutron-98760-lux", {place: 0x72}) for place in (0, 1, 2, 3, 5, 6, 7, 14, 15)),
    *(("ut325-four-digits", {place: 0x39}) for place in (5, 8, 13, 16, 17, 18)),
    ("ut325-four-digits", dict.fromkeys(range(1, 5), 0x3A)),
    # a start, an end, and temperatures that no thermocouple can give
    *(
        ("center-309-shows-relative", {place: byte})
        for place, byte in ((0, 3), (44, 2), (7, 0x7F), (9, 0x80))
    ),
    # digits that are not decimal, and blank ones where none may be
    *(("center-303-relative", digits) for digits in ({4: 0x3A}, {3: 0x2B}, {3: 0xBB, 4: 0xBB})),
    *(("pce-174-98700-lux", {place: byte}) for place, byte in ((2, 1), (3, 0x2A), (10, 100), (13, 200))),
    *(("nmea-gga", {place: byte}) for place, byte in ((20, 0x32), (-4, 0x37))),
]


@pytest.mark.parametrize(("name", "changed"), BROKEN, ids=str)
def test_no_byte_that_the_layout_fixes_may_be_another(name, changed):
    (golden,) = (golden for golden in GOLDEN if golden["id"] == name)
    data = bytearray(bytes_of(golden))
    for place, byte in changed.items():
        data[place] = byte
    decoded = registry.get(golden["driver"]).decode(bytes(data), {})
    assert decoded.rejected
    assert decoded.values == ()
