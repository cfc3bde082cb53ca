"""Deformed images of a result are read again from the run file, and from the run that it continues."""

import numpy as np
import pytest

from dic.derived.deformed_images import deformed_of_run
from dic.runfile.joined import exposures_us, open_run
from tests.dic.report.runs import INFO, camera, stretch, uncorrected
from tests.run_files import write_continued_run


@pytest.fixture(scope="module")
def continued(tmp_path_factory):
    return write_continued_run(tmp_path_factory.mktemp("runs"))


def test_steps_of_the_earlier_run_are_drawn_too(continued):
    with open_run(continued) as run:
        steps = run.series()[1:]
        images = [run.image("left", step) for step in steps]
    assert [step.index for step in steps] == [2, 3, 4, 5]
    measured = camera("left", steps, [stretch(0.0, 0.001)] * 4)
    result = uncorrected(str(continued), INFO, [measured])
    for place, image in enumerate(images):
        np.testing.assert_array_equal(deformed_of_run(result, "left", steps, place), image)


def test_exposures_are_those_of_both_files(continued):
    with open_run(continued) as run:
        # One frame for each of the six steps.
        assert exposures_us(run, "left").tolist() == [900.0] * 6
