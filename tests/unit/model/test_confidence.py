"""The quantiles of a confidence, against scipy's distributions."""

import pytest
from scipy.stats import chi2, norm

from fieldkit.model.confidence import interval_sds, misfit_drop, percent

CONFIDENCES = [0.5, 0.683, 0.90, 0.95, 0.99]


@pytest.mark.parametrize("confidence", CONFIDENCES)
@pytest.mark.parametrize("angles", [1, 2])
def test_a_likelihood_region_ends_at_the_chi_square_quantile(confidence, angles):
    assert misfit_drop(confidence, angles) == pytest.approx(chi2.ppf(confidence, angles), abs=5e-4)


@pytest.mark.parametrize("confidence", CONFIDENCES)
def test_an_interval_holds_that_share_of_a_normal_distribution(confidence):
    sds = interval_sds(confidence)
    assert norm.cdf(sds) - norm.cdf(-sds) == pytest.approx(confidence, abs=4e-4)


@pytest.mark.parametrize(("confidence", "words"), [(0.90, "90 %"), (0.95, "95 %"), (0.683, "68.3 %")])
def test_words(confidence, words):
    assert percent(confidence) == words
