import tomllib
from pathlib import Path

import pytest

from fieldkit.drivers import registry
from fieldkit.drivers.decoding import Decodes

GOLDEN = tomllib.loads((Path(__file__).parents[2] / "data/golden_records.toml").read_text())["record"]


def bytes_of(golden):
    return golden["text"].encode() if "text" in golden else bytes.fromhex(golden["hex"])


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden["id"])
def test_bytes_mean_what_the_maker_says(golden):
    driver = registry.get(golden["driver"])
    assert isinstance(driver, Decodes)
    decoded = driver.decode(bytes_of(golden), golden.get("options", {}))
    assert not decoded.rejected
    assert list(decoded.notes) == golden.get("notes", list(decoded.notes))
    assert decoded.rest == 0
    for value, expected in zip(decoded.values, golden["values"], strict=True):
        assert (value.unit, value.channel, value.flags) == tuple(
            expected[key] for key in ("unit", "channel", "flags")
        )
        assert value.value == pytest.approx(expected["value"], rel=1e-6, nan_ok=True)


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden["id"])
def test_a_record_is_found_again_after_noise_and_its_beginning_is_waited_for(golden):
    driver = registry.get(golden["driver"])
    assert isinstance(driver, Decodes)
    data = bytes_of(golden)
    noise = b"\xfe\xfd\xfc" + b"\n" * (golden["driver"] == "text")  # only the end of a line parts lines
    decoded = driver.decode(noise + data + data[:5], golden.get("options", {}))
    assert len(decoded.values) == len(golden["values"])
    assert [(part.offset, part.length) for part in decoded.rejected] == [(0, len(noise))]
    assert decoded.rest == 5
