"""Maps of one session with other windows and settings stand beside each other."""

import pytest

from fieldkit.results.slope_map import default_base


@pytest.mark.parametrize(
    ("window", "overrides", "name"),
    [
        (None, (), "slope-map"),
        (3600.0, (), "slope-map-60m"),
        ("all", (), "slope-map-all"),
        (None, ("estimator.model=full",), "slope-map-model-full"),
        ("all", ("surface.albedo=0.25", "estimator.noise_k=0.05"), "slope-map-all-noise_k-0.05-albedo-0.25"),
        (None, ("estimator.scale=@a b/c",), "slope-map-scale-_a_b_c"),
    ],
)
def test_a_window_and_settings_are_in_the_name(tmp_path, window, overrides, name):
    session = tmp_path / "recordings" / "noon.h5"
    assert default_base(session, window, overrides) == tmp_path / "results" / "noon" / name
