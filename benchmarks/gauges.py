"""Compare the processor time of gauges on a saved result with the time of the measurement that wrote it.

    python -m benchmarks.gauges [--images N] [--side-px N]

The images are 8 bit, with 2 grey levels of noise and up to about 1 % of strain. All kinds of gauges are read.
The time of `dic gauges` contains opening and reading the result file. Ends with status 1 if the gauges are
less than 20 times as fast as the measurement.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import cv2

from benchmarks.speckle import Speckle, eight_bit, gentle_strain
from dic.commands.correlate import correlate
from dic.derived.gauge_series import measure_gauges
from dic.gauges.declared import Extensometer, Gauge, LineCut, PointGauge, StrainGauge, TransverseExtensometer

LEAST = 20.0
NOISE = 2.0


def gauges_of(side_px: int) -> tuple[Gauge, ...]:
    """Return one gauge of each kind, for square images with sides of `side_px`."""
    near, middle, far = 0.15 * side_px, 0.5 * side_px, 0.85 * side_px
    return (
        Extensometer(name="axial", start=(middle, near), end=(middle, far), patch=60.0),
        TransverseExtensometer(
            name="width", start=(near, middle), end=(far, middle), patch=40.0, spread=0.5 * side_px
        ),
        StrainGauge(name="area", centre=(middle, middle), size=(0.5 * side_px, 0.3 * side_px)),
        LineCut(name="cut", start=(near, near), end=(far, far)),
        PointGauge(name="point", at=(middle, middle)),
    )


def measure_times(folder: Path, images: int, side_px: int) -> tuple[float, float]:
    """Return the processor times, s, of the measurement of all images and of the gauges on its result."""
    speckle = Speckle(shape=(side_px, side_px))
    for k, picture in enumerate([speckle.draw(), *[speckle.draw(gentle_strain())] * images]):
        cv2.imwrite(str(folder / f"img{k:03d}.png"), eight_bit(picture, NOISE, k))
    result = folder / "results.h5"
    begin = time.process_time()
    correlate.main([str(folder), "-o", str(result)], standalone_mode=False)
    between = time.process_time()
    found = measure_gauges(result, gauges_of(side_px))
    end = time.process_time()
    if not found.complete:
        raise RuntimeError("a gauge has no reading")
    return between - begin, end - between


def main() -> None:
    """Measure and print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--images", type=int, default=30)
    parser.add_argument("--side-px", type=int, default=1024)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measured_s, gauges_s = measure_times(Path(folder), given.images, given.side_px)
    ratio = measured_s / gauges_s
    print(f"measurement {measured_s:.2f} s, gauges {gauges_s:.3f} s of processor time: {ratio:.0f} times")
    sys.exit(0 if ratio >= LEAST else 1)


if __name__ == "__main__":
    main()
