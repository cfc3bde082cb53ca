"""Images of a run that another process reads from the same file, also if the file is replaced meanwhile."""

import pickle

import numpy as np
import pytest

from dic.errors import WorkerError
from dic.pipeline.run_image import RunImage
from dic.runfile.joined import open_run
from tests.run_files import write_continued_run, write_run


def sent(path, index):
    """Return the message with the image of a step, and the image's digest."""
    with open_run(path) as run:
        image = RunImage(run, "left", run.steps[index])
        return pickle.dumps(image), image.digest()


def test_run_file_that_is_replaced_is_read_anew(tmp_path):
    path, longer = write_run(tmp_path / "run.h5", loads=1), write_run(tmp_path / "longer.h5", loads=3)
    message, digest = sent(path, 2)
    received = pickle.loads(message)
    assert received.digest() == digest
    assert pickle.loads(message).run is received.run
    longer.replace(path)
    message, digest = sent(path, 4)
    assert pickle.loads(message).digest() == digest
    # A reference that was received before still has its image.
    np.testing.assert_array_equal(received(), pickle.loads(sent(path, 2)[0])())


def test_step_that_the_run_of_the_worker_lacks_is_one_sentence(tmp_path):
    path, shorter = write_run(tmp_path / "run.h5"), write_run(tmp_path / "shorter.h5", loads=1)
    message, _ = sent(path, 5)
    shorter.replace(path)
    with pytest.raises(WorkerError, match="got another one, with 3 steps; give all workers the same files"):
        pickle.loads(message)


@pytest.mark.parametrize("index", [2, 5])
def test_single_frame_has_the_integer_type_of_its_file(index, tmp_path):
    """Step 2 is in the file that the run continues."""
    with open_run(write_continued_run(tmp_path)) as run:
        image = RunImage(run, "left", run.steps[index])
        assert image().dtype == pickle.loads(pickle.dumps(image))().dtype == np.uint8
        plain = run.image("left", run.steps[index])
        assert plain.dtype == np.float32
        np.testing.assert_array_equal(image(), plain)
