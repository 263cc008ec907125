"""The bank against the equations as printed (Särkkä 2013, eqs. 4.20 and 4.21), on random numbers."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fieldkit.estimation.learned.bank import Affine, KalmanBank, Transition

BANK, STATES, FLOWS, READINGS = 3, 12, 4, 5
MOVED, DRIVES = 7, slice(6, 8)


@pytest.fixture
def random():
    return np.random.default_rng(7)


def bank_of(random):
    root = random.standard_normal((BANK, STATES, STATES))
    covariance = root @ root.transpose(0, 2, 1) / STATES
    return KalmanBank(random.standard_normal((BANK, STATES)), covariance + 0.1 * np.eye(STATES))


def affine(random, count):
    return Affine(random.standard_normal((BANK, count, STATES)), random.standard_normal((BANK, count)))


def test_prediction_is_the_product_of_whole_matrices(random):
    bank, flows = bank_of(random), affine(random, FLOWS)
    decay, into = random.uniform(0.0, 1.0, STATES), random.standard_normal((MOVED, FLOWS + 2))
    noise = random.uniform(0.0, 1.0, (BANK, STATES))
    F = np.tile(np.diag(decay), (BANK, 1, 1))
    F[:, :MOVED] += into[:, :FLOWS] @ flows.rows
    F[:, :MOVED, DRIVES] += into[:, FLOWS:]
    mean = (F @ bank.mean[..., np.newaxis])[..., 0]
    mean[:, :MOVED] += flows.constant @ into[:, :FLOWS].T
    covariance = [F[i] @ bank.covariance[i] @ F[i].T + np.diag(noise[i]) for i in range(BANK)]
    bank.predict(Transition(decay, into, flows, DRIVES), noise)
    np.testing.assert_allclose(bank.mean, mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(bank.covariance, covariance, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("missing", [[], [1, 3], list(range(READINGS))])
def test_update_is_the_gain_times_the_innovation(random, missing):
    bank, design, variance = bank_of(random), affine(random, READINGS), 0.3
    measured = random.standard_normal(READINGS)
    measured[missing] = np.nan
    mean, covariance, seen = bank.mean.copy(), bank.covariance.copy(), np.isfinite(measured)
    found = bank.update(design, measured, np.full((BANK, READINGS), variance))
    for i in range(BANK):
        H, P = design.rows[i][seen], covariance[i]
        S = H @ P @ H.T + variance * np.eye(seen.sum())
        K = P @ H.T @ np.linalg.inv(S)
        predicted = (H @ mean[i] + design.constant[i][seen]).tolist()
        np.testing.assert_allclose(bank.mean[i], mean[i] + K @ (measured[seen] - predicted), atol=1e-12)
        np.testing.assert_allclose(bank.covariance[i], P - K @ S @ K.T, atol=1e-12)
        log_likelihood = multivariate_normal(predicted, S).logpdf(measured[seen]) if seen.any() else 0.0
        assert found.log_likelihood[i] == pytest.approx(log_likelihood, abs=1e-12)
        assert np.isnan(found.standardised[i, missing]).all()
        whitened = found.standardised[i][seen]
        distance = (measured[seen] - predicted) @ np.linalg.solve(S, measured[seen] - predicted)
        assert whitened @ whitened == pytest.approx(distance, rel=1e-12)


def test_a_measurement_that_contradicts_all_others_moves_its_own_place_only(random):
    """Of three readings of one number one jumps by a hundred deviations: the number is the others' mean."""
    places = np.array([1, 2, 3])
    bank = KalmanBank(np.zeros((BANK, 4)), np.tile(np.diag([1.0, 1e-4, 1e-4, 1e-4]), (BANK, 1, 1)))
    rows = np.tile(np.column_stack([np.ones(3), np.eye(3)]), (BANK, 1, 1))
    measured = np.array([0.50, 0.52, 1.5])
    found = bank.update(Affine(rows, np.zeros((BANK, 3))), measured, np.full((BANK, 3), 1e-6), places)
    np.testing.assert_allclose(bank.mean[:, 0], 0.51, atol=0.01)
    np.testing.assert_allclose(bank.mean[:, 3], 0.99, atol=0.02)
    assert (found.log_likelihood > -20.0).all()  # about -5000 without the jump
