"""Weigh linear models by their evidence.

All models have the same linear equations, y = A θ + noise of unit variance. The models differ only in the
prior standard deviations of the parameters; a parameter with the prior standard deviation 0 is absent. The
posterior probability of a model is its prior probability times its evidence. The evidence is the probability
density of y under the model, integrated over all parameters (MacKay, *Bayesian interpolation*, 1992). A model
with more freedom spreads its probability density over more possible values of y. At the measured y, the
density of this model is therefore smaller than that of a simpler model that also explains y. The estimates of
the models are averaged with the posterior probabilities as weights (Hoeting et al., *Bayesian model
averaging*, 1999). So the uncertainty contains the differences between all models that the data do not
exclude.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Mask

_IGNORED = float(np.log(1e-4))
"""Models whose evidence is smaller than that of the best model by more than this factor are left out."""


@dataclass(frozen=True)
class Model:
    """One of the averaged models, with its posterior."""

    index: int
    """Index of the model in the list of prior standard deviations."""
    log_evidence: float
    """Logarithm of (prior probability times evidence), without a constant term. This term is the same for all
    models with the same data and the same free parameters.
    """
    estimate: Float
    """Shape (k,). Estimate of the parameters; the prior mean for free parameters."""
    misfit: float
    """Sum of the squares of the residuals and of the parameters, divided by their standard deviations."""
    normal: Float
    units: Float
    """Shapes (k', k') and (k',). Normal equations of the k' parameters that are not free, in these units."""
    seen: Float
    free: Mask
    """Shapes (p, k') and (k,). Columns of these parameters, and True for the free ones."""

    @property
    def gain(self) -> Float:
        """Derivative (k, p) of the estimate with respect to the data y; 0 for free parameters."""
        return np.asarray(gains([self])[0])


def gains(models: Sequence[Model]) -> Float:
    """Return the gains of models that have the same data and the same free parameters, (models, k, p)."""
    free, seen = models[0].free, models[0].seen
    units = np.array([model.units for model in models])[:, :, None]
    gain = np.zeros((len(models), len(free), len(seen)))
    gain[:, ~free] = units * np.linalg.solve(np.array([model.normal for model in models]), units * seen.T)
    return gain


def weigh(data: Float, columns: Float, prior_std: Float, prior_mean: Float, log_prior: Float) -> list[Model]:
    """Return the models that explain the data, with their evidence.

    Parameters
    ----------
    data : ndarray, shape (p,)
        Data y, whitened: their noise has the covariance 1.
    columns : ndarray, shape (p, k)
        The matrix A, whitened like the data.
    prior_std : ndarray, shape (models, k)
        Prior standard deviation of each parameter in each model; infinity for a parameter that is free in all
        models.
    prior_mean : ndarray, shape (k,)
        Prior mean of the parameters, the same in all models.
    log_prior : ndarray, shape (models,)
        Logarithms of the prior probabilities of the models.

    Returns
    -------
    list of Model
        The models in the order of `prior_std`, without improbable models.
    """
    free = np.isinf(prior_std[0])
    # Free parameters are integrated out: data and matrix are projected perpendicular to the columns of the
    # free parameters. The estimates of the free parameters are not needed.
    across = np.eye(len(data)) - _projection(columns[:, free])
    left, seen = across @ (data - columns @ prior_mean), across @ columns[:, ~free]
    # Express the parameters in units of their prior standard deviations. The equations of all models are then
    # well-conditioned, and an absent parameter needs no special case.
    units = prior_std[:, ~free]
    normal = units[:, :, None] * (seen.T @ seen) * units[:, None, :] + np.eye(seen.shape[1])
    scaled = np.linalg.solve(normal, (units * (seen.T @ left))[:, :, None])[:, :, 0]
    residual = left - (units * scaled) @ seen.T
    misfit = (residual**2).sum(axis=1) + (scaled**2).sum(axis=1)
    log_evidence = log_prior - 0.5 * misfit - 0.5 * np.linalg.slogdet(normal)[1]
    likely = np.flatnonzero(log_evidence > log_evidence.max() + _IGNORED)
    estimate = np.tile(prior_mean, (len(likely), 1))
    estimate[:, ~free] += units[likely] * scaled[likely]
    return [
        Model(int(m), float(log_evidence[m]), found, float(misfit[m]), normal[m], units[m], seen, free)
        for m, found in zip(likely, estimate, strict=True)
    ]


def _projection(columns: Float) -> Float:
    """Return the matrix that projects onto the columns."""
    basis, _ = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))
    return np.asarray(basis @ basis.T)


def probabilities(log_evidences: Float) -> Float:
    """Return the posterior probabilities of models from their logarithms of evidence; their sum is 1."""
    probability = np.exp(log_evidences - np.max(log_evidences))
    return np.asarray(probability / probability.sum())
