"""The light meter of a session that has several."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from fieldkit.calibrate.inputs import light_meter
from fieldkit.model.device import StreamInfo
from fieldkit.model.errors import ConfigError
from fieldkit.phrases import Words
from tests.harness.next_steps import at


def session(*names: str) -> SimpleNamespace:
    streams = {name: StreamInfo(name, "illuminance", "lx", (1,)) for name in names}
    return SimpleNamespace(path=Path("x.h5"), streams=streams)


def config(stream: str) -> SimpleNamespace:
    return SimpleNamespace(tables=SimpleNamespace(irradiance=SimpleNamespace(stream=stream)))


@pytest.mark.parametrize(
    ("names", "stream", "meter"),
    [(["lux"], "", "lux"), (["lux"], "cmp11", "lux"), (["lux", "roof"], "roof", "roof")],
)
def test_the_light_meter_is_the_only_one_or_the_one_that_the_configuration_names(names, stream, meter):
    assert light_meter(session(*names), config(stream)).name == meter


def test_of_several_that_none_names_the_refusal_says_how_to_name_one():
    with pytest.raises(ConfigError, check=at(session("lux", "roof").path)) as refused:
        light_meter(session("lux", "roof"), config(""))
    assert "irradiance.stream: lux, roof" in str(refused.value.fix)


def test_without_a_light_meter_the_refusal_says_that_there_is_none():
    with pytest.raises(ConfigError) as refused:
        light_meter(session(), config(""))
    assert isinstance(refused.value.fix, Words)
    assert refused.value.fix.key == "fix.none"
