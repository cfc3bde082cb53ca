from .bicubic import BicubicMap as BicubicMap
from .calibration import Calibration as Calibration
from .file import (
    load_calibration as load_calibration,
    save_calibration as save_calibration,
)
from .grid_making import GridAccuracy as GridAccuracy
from .pinhole.camera import Pinhole as Pinhole
from .pinhole.prior import KnownCamera as KnownCamera
from .plot import plot_calibration as plot_calibration
from .residuals import Residuals as Residuals
