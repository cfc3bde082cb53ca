"""Cholesky factor of a small positive definite matrix, and what is solved with it.

NumPy's would do, but from compiled code they allocate memory at every call.
"""

import math

from dic.correlation.kernel.jit import inner
from dic.typing import Float

_SINGULAR = 1e-6
"""A pivot below this share of its diagonal element means that the matrix is singular to working precision."""


@inner
def factorise(A: Float) -> bool:
    """Replace the lower triangle of `A` by its Cholesky factor L; False if `A` is not positive definite."""
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
    """Solve the leading n equations of L L' x = b for the leading n unknowns; set the others to 0."""
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
