"""Units of meters, by the definitions of NIST Special Publication 811, appendix B."""

import pytest

from fieldkit.model.quantities import meaning_of

EXACT = [
    ("°C", 0.0, 273.15),
    ("°C", 25.0, 298.15),
    ("°F", 32.0, 273.15),
    ("°F", 212.0, 373.15),
    ("°F", -40.0, 233.15),
    ("fc", 1.0, 10.763910416709722),  # one lumen per square foot of 0.3048 m a side
    ("W/m²", 843.5, 843.5),
]


@pytest.mark.parametrize(("unit", "shown", "stored"), EXACT)
def test_what_a_meter_shows_is_stored_in_si(unit, shown, stored):
    meaning = meaning_of(unit)
    assert meaning is not None
    assert meaning.in_stream_unit(shown) == pytest.approx(stored, rel=1e-12)
