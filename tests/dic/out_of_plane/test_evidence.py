"""The evidence of models is compared with the probability density of the data, computed directly."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dic.out_of_plane.evidence import probabilities, weigh

RNG = np.random.default_rng(8)
COLUMNS = RNG.normal(size=(12, 4))
DATA = RNG.normal(size=12) * 2
STD = np.array([[np.inf, np.inf, *others] for others in ((0, 0), (2, 0), (0.5, 3))])
MEAN = np.array([0.0, 0.0, 0.3, -0.2])


def density(data, std):
    """Return the log density of the part of the data that the free parameters cannot change."""
    free = np.isinf(std)
    across = np.linalg.svd(COLUMNS[:, free])[0][:, free.sum() :].T
    seen = across @ COLUMNS[:, ~free]
    covariance = np.eye(len(across)) + seen @ np.diag(std[~free] ** 2) @ seen.T
    return multivariate_normal(seen @ MEAN[~free], covariance).logpdf(across @ data)


def test_evidence_is_the_density_of_the_data():
    models = weigh(DATA, COLUMNS, STD, MEAN, np.log([0.5, 0.3, 0.2]))
    exact = [density(DATA, std) + np.log(p) for std, p in zip(STD, (0.5, 0.3, 0.2), strict=True)]
    found = np.array([m.log_evidence for m in models])
    np.testing.assert_allclose(probabilities(found), probabilities(np.array(exact)), rtol=1e-9)


def test_the_estimate_is_the_one_of_the_normal_equations():
    best = weigh(DATA, COLUMNS, STD[2:], MEAN, np.zeros(1))[0]
    precision = np.diag([0, 0, 1 / 0.25, 1 / 9])
    exact = np.linalg.solve(COLUMNS.T @ COLUMNS + precision, COLUMNS.T @ DATA + precision @ MEAN)
    np.testing.assert_allclose(best.estimate[2:], exact[2:], rtol=1e-9)
    ahead = weigh(DATA + 1e-3 * np.eye(12)[5], COLUMNS, STD[2:], MEAN, np.zeros(1))[0]
    np.testing.assert_allclose((ahead.estimate - best.estimate) / 1e-3, best.gain[:, 5], atol=1e-9)


@pytest.mark.parametrize("planted", [0.0, 5.0])
def test_a_cause_is_found_if_and_only_if_it_is_there(planted):
    rng = np.random.default_rng(3)
    counts = []
    for _ in range(50):
        data = planted * COLUMNS[:, 2] + rng.normal(size=12)
        models = weigh(data, COLUMNS, STD[:2], 0 * MEAN, np.zeros(2))
        share = probabilities(np.array([m.log_evidence for m in models]))
        counts.append(sum(p for p, m in zip(share, models, strict=True) if m.index == 1))
    assert np.mean(counts) > 0.99 if planted else np.mean(counts) < 0.45


def test_models_without_a_chance_are_left_out():
    data = 100 * COLUMNS[:, 2]
    assert [m.index for m in weigh(data, COLUMNS, STD[:2], 0 * MEAN, np.zeros(2))] == [1]
