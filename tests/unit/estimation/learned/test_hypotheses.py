"""Hypotheses are drawn where the posterior lies: a known one comes back with its mean and covariance."""

import numpy as np
import pytest
from scipy.stats import qmc

from fieldkit.estimation.learned.hypotheses import (
    UNKNOWNS,
    Proposal,
    effective,
    even_points,
    log_prior,
    normalise,
)

CENTRE = np.array([2.0, -1.0, 0.5, -3.0, 1.5])
TURNED = np.linalg.qr(np.random.default_rng(1).standard_normal((UNKNOWNS, UNKNOWNS)))[0]


def log_density(points, sds):
    """Of a normal distribution around `CENTRE` whose axes lie askew, up to a constant."""
    return -0.5 * np.sum(((points - CENTRE) @ TURNED / sds) ** 2, axis=1)


@pytest.mark.parametrize("sds", [np.full(UNKNOWNS, 0.5), np.array([0.05, 0.1, 0.3, 0.6, 1.0])])
def test_a_normal_posterior_is_found_in_few_rounds(sds):
    proposal, rounds = Proposal.prior(), 0
    points = proposal.draw(128)
    while effective(weights := log_density(points, sds) - proposal.log_density(points)) < 50.0:
        proposal, rounds = Proposal.fit(points, log_density(points, sds)), rounds + 1
        points = proposal.draw(128)
        assert rounds < 6
    mean = normalise(weights) @ points
    assert np.all(np.abs((mean - CENTRE) @ TURNED) < 0.2 * sds)
    away = (points - mean) @ TURNED
    assert np.sqrt(normalise(weights) @ away**2) == pytest.approx(sds, rel=0.25)


def test_a_flat_posterior_is_the_prior():
    points = Proposal.prior().draw(128)
    found = Proposal.fit(points, log_prior(points))
    assert np.abs(found.centre).max() < 0.2
    assert found.root @ found.root.T == pytest.approx(1.44 * np.eye(UNKNOWNS), abs=0.4)


@pytest.mark.parametrize(
    ("table", "dimensions", "seed", "count"), [("sobol-5", 5, 20170830, 256), ("sobol-2", 2, 1, 32)]
)
def test_packaged_points_are_those_of_scipys_sobol_sequences_bit_for_bit(table, dimensions, seed, count):
    expected = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed)).random(count)
    np.testing.assert_array_equal(even_points(table), expected)
