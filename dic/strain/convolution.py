"""Linear convolution by Fourier transforms.

`scipy.signal` has the same function, but needs a second to load.
"""

import numpy as np

from dic.typing import Float


def convolved(one: Float, other: Float) -> Float:
    """Return the convolution of two arrays along their first two axes, in full length.

    The further axes of the arrays must have equal lengths or length 1.

    `one` has the shape (a, b, …). `other` has the shape (c, d, …).

    The result has the shape (a + c - 1, b + d - 1, …).
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    rows, columns = (n + m - 1 for n, m in zip(one.shape[:2], other.shape[:2], strict=True))
    # Zeros behind the arrays keep the periodic convolution of the transforms from wrapping around.
    padded = [next_fast_len(length, real=True) for length in (rows, columns)]
    spectrum = rfft2(one, padded, axes=(0, 1)) * rfft2(other, padded, axes=(0, 1))
    return np.asarray(irfft2(spectrum, padded, axes=(0, 1))[:rows, :columns])
