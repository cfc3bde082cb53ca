"""Find the causes of a displacement field, by equations that are linearised about a plane of the specimen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dic.out_of_plane.causes import OUT_OF_PLANE, fields, places, strain_along
from dic.out_of_plane.evidence import Model, gains, probabilities, weigh
from dic.out_of_plane.expectations import Expectations
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.polynomial import COEFFICIENTS, GRADIENT, Polynomial
from dic.typing import Float

_NO_STRAIN = 1e-6
PARTS = {
    "calibration": (),
    "still": (),
    "mounting": ("mounted tilt", "gap"),
    "model": ("bending", "tilt", "curvature", "gradient", "taper"),
    "shift": ("shift",),
}
"""The causes that belong to each part of the standard deviation. Some parts belong to none."""


@dataclass(frozen=True)
class ModelOutcome:
    """The result of one model for a displacement field."""

    log_evidence: float
    """Logarithm of the model's evidence, up to a constant."""
    curved: bool
    graded: bool
    """True if the model allows a curvature out of the plane, and a gradient of the strain."""
    misfit: float
    """Misfit of the model; its expected value for a correct model is 14."""
    slopes: Float
    slope_std: Float
    """Shape (2,). Slopes of the specimen's plane since the reference."""
    curvatures: Float
    """Shape (3,). Curvatures of the surface since the reference: along X, mixed, along Y; 1/mm."""
    gradient: Float
    """Shape (4,). Corrected mean displacement gradient, elements xx, xy, yx, yy."""
    parts: Mapping[str, Float]
    """Each of shape (4, 4). Covariances of the gradient by their cause: "images" and the names in `PARTS`."""
    mounting: Float
    """Shape (4, 3). Errors of the gradient if the two slopes and the distance of the specimen in the
    reference each differ by one standard deviation from the grid's plane. The part "mounting" is their sum of
    squares.
    """
    relative_gradient: float
    """Gradient of the strain as a fraction of the strain, 1/mm."""

    def stretched_along(self, along: Float) -> bool:
        """Return True if the absolute strain along a direction (2,) is larger than the one across it."""
        strain, across = strain_along(self.gradient.reshape(2, 2), along)
        return abs(strain) > abs(across)


@dataclass(frozen=True)
class Linearised:
    """The equations of all causes, linearised about a plane."""

    plane: Plane
    polynomial: Polynomial
    data: Float
    """Shape (24,). The polynomial of the displacements on the plane."""
    columns: Float
    """Shape (24, 19). The polynomials of the causes' fields."""
    strain: float
    """Strain along the direction in which the strain may have a gradient."""

    @classmethod
    def about(
        cls,
        plane: Plane,
        polynomial: Polynomial,
        poisson_ratio: float,
        along: Float,
        per_slope_mm: Float,
    ) -> "Linearised":
        """Return the equations about `plane`; `along` (2,) is the direction of the strain's gradient.

        The argument `per_slope_mm` (2,) is the shift that a unit of each slope causes.
        """
        data = polynomial.sight.moved(plane)
        gradient = data[GRADIENT].reshape(2, 2)
        columns = fields(polynomial.sight, plane, gradient, poisson_ratio, along, per_slope_mm)
        return cls(plane, polynomial, data, columns, strain_along(gradient, along)[0])

    def models(self, expected: Expectations) -> list[Model]:
        """Return the probable models for the whitened coefficients."""
        white = self.polynomial.whitening
        # The slopes since the reference are expected to be 0. So the expected change of the present plane is
        # minus its slopes.
        mean = np.zeros(self.columns.shape[1])
        mean[places()["tilt"]] = -self.plane.slope_x, -self.plane.slope_y
        return weigh(
            white @ self.data[COEFFICIENTS],
            white @ self.columns[COEFFICIENTS],
            expected.std,
            mean,
            expected.log_prior,
        )

    def mean_step(self, models: Sequence[Model]) -> Float:
        """Return the mean change (2,) of the plane's slopes, averaged over the models."""
        share = probabilities(np.array([model.log_evidence for model in models]))
        return np.asarray(share @ np.array([model.estimate[places()["tilt"]] for model in models]))

    def outcomes(self, models: Sequence[Model], expected: Expectations) -> list[ModelOutcome]:
        """Return the results of the models for the field."""
        at, std = places(), expected.std[[model.index for model in models]]
        gain = gains(models) @ self.polynomial.whitening
        out = np.concatenate([np.arange(std.shape[1])[at[name]] for name in OUT_OF_PLANE])
        false, tilt = self.columns[GRADIENT, out], at["tilt"]
        # An estimate has two kinds of errors: the part of its own cause that it misses, and the part of other
        # causes that it mistakes for its own.
        known = np.where(np.isinf(std), 0.0, std)[:, None, :]
        missed = (gain @ self.columns[COEFFICIENTS] - np.eye(std.shape[1])) * known
        by_errors = ((gain[:, tilt] @ self.polynomial.errors) * gain[:, tilt]).sum(axis=2)
        slope_std = np.sqrt((missed[:, tilt] ** 2).sum(axis=2) + by_errors)
        parts = self._parts(-false @ gain[:, out], false @ missed[:, out])
        mounting = np.concatenate(
            [-false @ missed[:, out][:, :, at[name]] for name in PARTS["mounting"]], axis=2
        )
        return [
            ModelOutcome(
                model.log_evidence,
                *expected.kind(model.index),
                model.misfit,
                np.array([self.plane.slope_x, self.plane.slope_y]) + model.estimate[tilt],
                slope_std[k],
                model.estimate[at["curvature"]],
                self.data[GRADIENT] - false @ model.estimate[out],
                {name: part[k] for name, part in parts.items()},
                mounting[k],
                float(model.estimate[at["gradient"]][0]) / max(abs(self.strain), _NO_STRAIN),
            )
            for k, model in enumerate(models)
        ]

    def _parts(self, by_coefficients: Float, missed: Float) -> dict[str, Float]:
        """Return the covariances (m, 4, 4) of the gradients of m models by their cause.

        `by_coefficients`, shape (m, 4, 20): corrections of the gradients by the coefficients. `missed`, shape
        (m, 4, 19): errors of the gradients by the causes.
        """
        rows = np.concatenate(
            [by_coefficients, np.broadcast_to(np.eye(4), (len(by_coefficients), 4, 4))], axis=2
        )
        turned, polynomial = np.swapaxes(rows, 1, 2), self.polynomial
        parts = {
            "images": rows @ polynomial.noise @ turned,
            "calibration": rows @ polynomial.by_calibration @ turned,
            "still": rows @ polynomial.still @ turned,
        }
        for part, names in PARTS.items():
            for name in names:
                here = missed[:, :, places()[name]]
                parts[part] = parts.get(part, 0.0) + here @ np.swapaxes(here, 1, 2)
        return parts
