"""Cholesky factor of a small positive definite matrix, and the solution of equations with this factor.

NumPy's functions are not used, because in compiled code they allocate memory at every call.
"""

import math

from dic.correlation.kernel.jit import inner
from dic.typing import Float

_SINGULAR = 1e-6
"""The matrix counts as singular if a pivot is below this fraction of its diagonal element."""


@inner
def factorise(A: Float) -> bool:
    """Replace the lower triangle of `A` by the Cholesky factor L; return False if `A` has no such factor.

    Only a positive definite matrix has a Cholesky factor.
    """
    for i in range(len(A)):
        limit = _SINGULAR * A[i, i]
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            if i == j:
                if not s > limit:
                    return False
                A[i, i] = math.sqrt(s)
            else:
                A[i, j] = s / A[j, j]
    return True


@inner
def solve(L: Float, b: Float, n: int, x: Float) -> None:
    """Solve the first n equations of L L' x = b, with a Cholesky factor L; set further unknowns to 0."""
    for i in range(n):
        s = b[i]
        for j in range(i):
            s -= L[i, j] * x[j]
        x[i] = s / L[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for j in range(i + 1, n):
            s -= L[j, i] * x[j]
        x[i] = s / L[i, i]
    for i in range(n, len(b)):
        x[i] = 0.0
