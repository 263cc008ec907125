"""The component of a radiation stream: declared, stated, or named."""

import pytest

from fieldkit.model.channels import components_named, radiation_components, with_components
from fieldkit.model.device import StreamInfo


def stream(name="sun", quantity="irradiance", unit="W m-2", channels=1, **more):
    return StreamInfo(name, quantity, unit, (channels,), **more)


def test_configuration_stands_above_what_a_stream_declares():
    tilted = stream(measures=("ghi", "ghi"), channels=2)
    assert radiation_components(tilted, {"sun": "gti", "other": "dni"}) == ("gti", "gti")
    assert with_components(stream(), {"sun": "dhi"}).measures == ("dhi",)
    assert with_components(stream(), {}) == stream()


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        (["GHI_Avg", "dhi_w_m2", "cell"], ("ghi", "dhi", "")),
        (["sun", "radiation", "pyranometer 2"], ()),
        (["longwave_down"], ("longwave_down",)),
    ],
)
def test_only_the_components_own_names_say_what_a_column_measures(labels, expected):
    assert components_named(labels) == expected
