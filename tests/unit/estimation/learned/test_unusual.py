"""What a bed hardly ever does: the mixture of two priors, against samples of the filters' distribution."""

import numpy as np
import pytest
from scipy.stats import norm

from fieldkit.estimation.learned.prior_state import DRYING_MINUTES, DRYING_W_M2
from fieldkit.estimation.learned.unusual import USUAL, USUAL_DRYING_W_M2, with_usual_beds
from tests.unit.estimation.learned.test_truth import filtered

MINUTES = 25


@pytest.mark.parametrize("drying_w_m2", [0.0, -15.0, -100.0])
def test_the_mixture_of_both_priors_has_the_moments_and_the_evidence_of_weighted_samples(drying_w_m2):
    """Samples under the wide prior, each weighed by the mixture of both over the wide one."""
    filters = filtered("known", minutes=MINUTES)
    faded = np.exp(-(MINUTES - 1) / DRYING_MINUTES)
    place, gain = filters.layout.drying(0), filters.layout.place("gain")
    filters.mean[:, place] = drying_w_m2 * faded
    usual = with_usual_beds(filters, (MINUTES - 1) / 60.0)

    both = [place, gain]
    random, spread = np.random.default_rng(5), filters.covariance[0][np.ix_(both, both)]
    samples = random.multivariate_normal(filters.mean[0, both], spread, 400_000)
    narrow, wide = (norm.pdf(samples[:, 0] / faded, scale=sd) for sd in (USUAL_DRYING_W_M2, DRYING_W_M2))
    weights = USUAL * narrow / wide + 1.0 - USUAL
    shares = weights / weights.sum()
    mean = shares @ samples
    scale = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(usual.mean[0, both] / scale, mean / scale, atol=0.01)
    away = (samples - mean) / scale
    covariance = usual.covariance[0][np.ix_(both, both)] / np.outer(scale, scale)
    np.testing.assert_allclose(covariance, (shares[:, np.newaxis] * away).T @ away, atol=0.02)
    evidence = usual.log_likelihood - filters.log_likelihood
    assert evidence[0] == pytest.approx(np.log(weights.mean()), abs=0.02)
