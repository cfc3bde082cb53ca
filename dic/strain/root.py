"""The root of a function of one variable, by Brent's method.

`scipy.optimize` has the same function, but takes half a second to load.
"""

import math
import sys
from collections.abc import Callable

_ABSOLUTE, _RELATIVE = 2e-12, 4 * sys.float_info.epsilon
"""Largest error of the root."""

_STEPS = 100


def root(function: Callable[[float], float], first: float, last: float) -> float:
    """Return a root between two arguments at which the function has opposite signs.

    R. P. Brent, Algorithms for Minimization Without Derivatives (1973), chapter 4. Each step is that of
    `scipy.optimize.brentq`, so the result is the same number.
    """
    before, here = first, last
    f_before, f_here = function(before), function(here)
    if f_before * f_here > 0.0:
        raise ValueError(f"the function has the same sign at {first:g} and {last:g}")
    other = f_other = step = step_before = 0.0
    for _ in range(_STEPS):
        if f_before != 0.0 and f_here != 0.0 and (f_before < 0.0) != (f_here < 0.0):
            other, f_other = before, f_before
            step = step_before = here - before
        if abs(f_other) < abs(f_here):
            before, here, other = here, other, here
            f_before, f_here, f_other = f_here, f_other, f_here
        least = (_ABSOLUTE + _RELATIVE * abs(here)) / 2
        half = (other - here) / 2
        if f_here == 0.0 or abs(half) < least:
            return here
        trial = math.inf
        if abs(step_before) > least and abs(f_here) < abs(f_before):
            if before == other:
                trial = -f_here * (here - before) / (f_here - f_before)
            else:
                rise, rise_other = (f_before - f_here) / (before - here), (f_other - f_here) / (other - here)
                trial = -f_here * (f_other * rise_other - f_before * rise)
                trial /= rise_other * rise * (f_other - f_before)
        if 2 * abs(trial) < min(abs(step_before), 3 * abs(half) - least):
            step_before, step = step, trial
        else:
            step_before = step = half
        before, f_before = here, f_here
        here += step if abs(step) > least else math.copysign(least, half)
        f_here = function(here)
    raise ValueError(f"no root found between {first:g} and {last:g}")
