"""Off-axis two-dimensional digital image correlation: images in, calibrated fields and strains out.

>>> import dic
>>> series = dic.measure_images("reference.tif", ["deformed.tif"], calibration="calibration.h5")
>>> series.images[0].mean.exx

What most scripts need is at the top of this package. The rest is in packages below it, such as `dic.gauges`
and `dic.properties`. Each name is loaded when it is first used.

Images are arrays of shape (height, width) or files. Results are frozen dataclasses. A measurement that fails
raises a `MeasurementError`, whose message is one sentence that ends with a remedy.
"""

import warnings
from pkgutil import iter_modules
from typing import Any

from lazy_loader import attach_stub

_load, __dir__, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Load a public name, also by the place it had at the top of this package until version 0.1."""
    if name == "__version__":
        from importlib.metadata import version

        return version("offaxis")
    if name in __all__ or name.startswith("_"):
        return _load(name)
    for below in iter_modules(__path__):
        package = _load(below.name) if below.name in __all__ else None
        if name in getattr(package, "__all__", ()):
            warnings.warn(f"dic.{name} is dic.{below.name}.{name} now", DeprecationWarning, stacklevel=2)
            return getattr(package, name)
    return _load(name)
