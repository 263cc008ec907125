import pytest

from fieldkit.model.errors import ConfigError
from fieldkit.workflows.sweep import read_grid


def test_a_range_holds_both_ends_in_decimals_as_one_would_write_them():
    (parameter,) = read_grid(["surface.albedo=0.15:0.35:0.05"]).parameters
    assert parameter.values == ("0.15", "0.20", "0.25", "0.30", "0.35")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.88,0.90 , 0.92", ("0.88", "0.90", "0.92")),
        ("paper,full", ("paper", "full")),
        ("600", ("600",)),
        ("-40:-20:10,0", ("-40", "-30", "-20", "0")),
        ("0:1:0.4", ("0.0", "0.4", "0.8")),
        ("1e-1:0.3:0.1", ("0.1", "0.2", "0.3")),
        ('["cloud", "cable"]', ('["cloud", "cable"]',)),
        ("0.2,0.2", ("0.2",)),
    ],
)
def test_lists_ranges_and_single_values(text, values):
    assert read_grid([f"a.b={text}"]).parameters[0].values == values


def test_sets_are_all_combinations_the_last_parameter_fastest():
    grid = read_grid(["a.x=1,2", "a.y=5", "a.z=p,q"])
    assert grid.sets == [
        ("a.x=1", "a.y=5", "a.z=p"), ("a.x=1", "a.y=5", "a.z=q"),
        ("a.x=2", "a.y=5", "a.z=p"), ("a.x=2", "a.y=5", "a.z=q"),
    ]  # fmt: skip
    assert [parameter.key for parameter in grid.varied] == ["a.x", "a.z"]


@pytest.mark.parametrize("text", ["0.3:0.1:0.1", "0:1:0", "0:1:-0.1", "0:1:0.000001"])
def test_a_range_that_goes_nowhere_is_refused(text):
    with pytest.raises(ConfigError, match="is not a valid range"):
        read_grid([f"surface.albedo={text}"])


@pytest.mark.parametrize("setting", ["surface.albedo", "surface.albedo=", "=0.2"])
def test_a_setting_without_key_or_value_is_refused(setting):
    with pytest.raises(ConfigError, match="no value"):
        read_grid([setting])


def test_a_key_given_twice_is_refused():
    with pytest.raises(ConfigError, match="more than once"):
        read_grid(["a.b=1", "a.b=2"])
