import math

import pytest

from fieldkit.calibration.uniformity import TargetView, uniformity
from fieldkit.model.errors import CalibrationError

HOUR = 3_600_000_000_000


def view(b15: float, hour: float = 0.0, sd: float = 0.02, **more) -> TargetView:
    return TargetView(round(hour * HOUR), {"b05": -0.06, "b15": b15}, {"b05": sd, "b15": sd}, **more)


def test_one_look_is_its_offset_with_scatter_and_target_as_uncertainty():
    found = uniformity(view(0.31), target_sd_k=0.05)
    assert found.offset_k == {"b05": -0.06, "b15": 0.31}
    assert found.standard_uncertainty_k("b15") == pytest.approx(math.hypot(0.02, 0.05))
    assert math.isnan(found.drift_k_per_h["b15"])


def test_two_looks_are_averaged_whatever_their_order_and_half_the_change_bounds_what_was_between():
    for pair in ((view(0.31), view(0.43, 3.0)), (view(0.43, 3.0), view(0.31))):
        found = uniformity(*pair, target_sd_k=0.0)
        assert found.offset_k["b15"] == pytest.approx(0.37)
        assert found.drift_k_per_h["b15"] == pytest.approx(0.04)
        # rectangular of half width 0.06 K (GUM 4.3.7), and the scatter of a mean of two
        expected = math.hypot(0.06 / math.sqrt(3), 0.02 / math.sqrt(2))
        assert found.standard_uncertainty_k("b15") == pytest.approx(expected)
        assert found.worst == "b15"


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (view(8.0), None, "b15: differs from the reference by \\+8.0 K"),
        (view(-8.0), None, "b15: differs from the reference by -8.0 K"),
        (view(math.nan), None, "b15"),
        (view(0.3, change_k=0.5), None, "drift apart by 0.5 K"),
        (view(0.3), TargetView(HOUR, {"b05": 0.0}, {"b05": 0.1}), "not the same"),
        (view(0.3, 1.0), view(0.3, 1.0), "the same recording"),  # it showed no drift between two looks
    ],
)
def test_what_is_no_uniform_target_is_refused(before, after, said):
    with pytest.raises(CalibrationError, match=said):
        uniformity(before, after)
