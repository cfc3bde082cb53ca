"""Linear convolution by Fourier transforms."""

from dic.image.fourier import irfft2, next_fast_len, rfft2
from dic.typing import Float


def convolved(one: Float, other: Float) -> Float:
    """Return the convolution of two arrays along their first two axes, in full length.

    The further axes of the arrays must have equal lengths or length 1.

    `one` has the shape (a, b, …). `other` has the shape (c, d, …).

    The result has the shape (a + c - 1, b + d - 1, …).
    """
    rows, columns = (n + m - 1 for n, m in zip(one.shape[:2], other.shape[:2], strict=True))
    # Zeros behind the arrays keep the periodic convolution of the transforms from wrapping around.
    padded = next_fast_len(rows), next_fast_len(columns)
    spectrum = rfft2(one, padded) * rfft2(other, padded)
    return irfft2(spectrum, padded)[:rows, :columns]
