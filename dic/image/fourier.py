"""SciPy's Fourier transforms of two axes, without the import of `scipy.fft`.

That import takes longer than the correlation of a small image. The compiled part of `scipy.fft` needs no
other module. NumPy's transforms round otherwise.
"""

from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PLACES = ("_duccfft", "pyduccfft"), ("_pocketfft", "pypocketfft")
"""Folder and module of the compiled part, from SciPy 1.18 on and before; their functions are the same."""

_INVERSE = 2
"""SciPy's number for the division by the number of elements, which belongs to the inverse transform."""


def fft2(values: NDArray[Any]) -> NDArray[Any]:
    """Return the transform of the last two axes."""
    if _compiled() is None:
        from scipy import fft

        return np.asarray(fft.fft2(values))
    axes = values.ndim - 2, values.ndim - 1
    return np.asarray(_compiled().c2c(values, axes, True, 0, None, 1))


def rfft2(values: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Return the transform of the first two axes of real values, with zeros appended up to `size`."""
    if _compiled() is None:
        from scipy import fft

        return np.asarray(fft.rfft2(values, size, axes=(0, 1)))
    padded = np.zeros((*size, *values.shape[2:]), values.dtype)
    padded[: len(values), : values.shape[1]] = values
    return np.asarray(_compiled().r2c(padded, (0, 1), True, 0, None, 1))


def irfft2(waves: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Return the real values whose transform of the first two axes is `waves`; they have the shape `size`."""
    if _compiled() is None:
        from scipy import fft

        return np.asarray(fft.irfft2(waves, size, axes=(0, 1)))
    waves = waves if np.iscomplexobj(waves) else waves + 0.0j
    # Of the second axis, the transform of real values has only the first half.
    waves = waves[:, : size[1] // 2 + 1]
    return np.asarray(_compiled().c2r(waves, (0, 1), size[1], False, _INVERSE, None, 1))


def next_fast_len(length: int) -> int:
    """Return the smallest size, at least `length`, for which transforms of real values are fast."""
    if _compiled() is None:
        from scipy import fft

        return int(fft.next_fast_len(length, real=True))
    return int(_compiled().good_size(length, True))


@cache
def _compiled() -> Any:
    """Return the compiled part of `scipy.fft`; None if this version of SciPy keeps it elsewhere."""
    package = find_spec("scipy")
    if package is None or package.origin is None:
        return None
    for folder, name in _PLACES:
        found = PathFinder.find_spec(name, [str(Path(package.origin).parent / "fft" / folder)])
        if found is not None and found.loader is not None:
            module = module_from_spec(found)
            found.loader.exec_module(module)
            return module
    return None
