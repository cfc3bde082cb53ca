"""Test of the memory that the correlation of two large images needs."""

import subprocess
import sys

import pytest

PROGRAM = """
import resource
import cv2
import numpy as np
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings

def picture(height, width):
    noise = np.random.default_rng(0).standard_normal((height, width), np.float32)
    return cv2.GaussianBlur(noise, (0, 0), 1.8) * 300 + 128

def peak_bytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

settings = CorrelationSettings(subset_px=21, step_px=5)
small = picture(200, 200)
Correlator(small, settings=settings).correlate(np.roll(small, 2, axis=1))
before = peak_bytes()
reference = picture(4000, 5000)
deformed = np.roll(reference, (1, 3), (0, 1))
field = Correlator(reference, settings=settings).correlate(deformed)
assert field.converged.sum() > 0.99 * field.in_view
print((peak_bytes() - before) / reference.nbytes)
"""


@pytest.mark.long
def test_twenty_megapixels_at_step_5_take_less_than_twelve_images(tmp_path):
    """Both images included, in float32; the compiled program itself is there before."""
    result = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert float(result.stdout) < 12.0
