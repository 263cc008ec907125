"""The packaged points are those of SciPy's Sobol sequences, bit for bit."""

import numpy as np
import pytest
from scipy.stats import qmc

from fieldkit.estimation.learned.hypotheses import even_points


@pytest.mark.parametrize(
    ("table", "dimensions", "seed", "count"), [("sobol-5", 5, 20170830, 256), ("sobol-2", 2, 1, 32)]
)
def test_equal_to_scipy(table, dimensions, seed, count):
    expected = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed)).random(count)
    np.testing.assert_array_equal(even_points(table), expected)
