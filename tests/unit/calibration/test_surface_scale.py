import numpy as np
import pytest

from fieldkit.calibration.surface_scale import BedScale, pool
from fieldkit.model.errors import CalibrationError


@pytest.mark.parametrize(
    ("beds", "kappa", "sd"),
    [
        ({"b15": BedScale(1.13, 0.01, -0.03)}, 1.13, np.hypot(0.01, 0.03)),
        ({f"b{n}": BedScale(1.1 + 0.005 * n, 0.01, 0.02) for n in (-1, 0, 1)}, 1.1, 0.02236 / np.sqrt(3)),
        # weights 1/u² (GUM 5, inverse variances): 1/0.0001 beside 1/0.001
        ({"b25": BedScale(1.0, 0.01, 0.0), "b05": BedScale(1.022, 0.01, 0.03)}, 11.022 / 11.0, None),
    ],
)
def test_beds_count_by_what_their_tilts_determine_and_are_better_together(beds, kappa, sd):
    found = pool(beds, 0.5)
    assert found.kappa == pytest.approx(kappa)
    assert sd is None or found.standard_uncertainty == pytest.approx(sd, rel=1e-4)
    assert found.freedom == len(beds) - 1


def test_beds_that_disagree_beyond_noise_make_the_scale_less_certain():
    found = pool({"b05": BedScale(1.0, 0.005, 0.005), "b25": BedScale(1.3, 0.005, 0.005)}, 0.1)
    assert found.kappa == pytest.approx(1.15)
    assert found.standard_uncertainty == pytest.approx(0.15, rel=0.02)
    assert max(found.budget, key=lambda line: line.effect).name == "beds disagree"


@pytest.mark.parametrize(
    ("beds", "said"),
    [
        ({"b15": BedScale(0.2, 0.01, 0.01)}, "no surface has"),
        ({"b05": BedScale(0.5, 0.01, 0.01), "b25": BedScale(1.6, 0.01, 0.01)}, "the beds disagree: b05 0.50"),
    ],
)
def test_what_no_surface_has_is_refused(beds, said):
    with pytest.raises(CalibrationError, match=said):
        pool(beds, 0.5)
