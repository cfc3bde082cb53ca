"""`--workers`: several processes give the bits of one, in whatever order they finish."""

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.command_line import refusal, run_dic
from tests.dic.pipeline.rendered_run import slid, write_rendered_run
from tests.dic.result_values import results
from tests.image_files import write_image


@pytest.fixture(scope="module")
def images(speckle, tmp_path_factory):
    """A reference and eleven images; one shows nothing, and one is damaged."""
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21, shape=(120, 120))
    for number in range(12):
        moved = pattern.draw(lambda x, y, by=0.37 * number: (x - by, y))
        write_image(folder / f"img{number:02d}.png", np.full((120, 120), 128.0) if number == 4 else moved)
    damaged = folder / "img07.png"
    damaged.write_bytes(damaged.read_bytes()[:2000])
    return folder


def test_processes_give_the_bits_of_one_processor(images, tmp_path, monkeypatch):
    monkeypatch.chdir(images.parent)
    words = ("correlate", images.name, "--subset", 21, "--step", 20)
    one, two = tmp_path / "one.h5", tmp_path / "two.h5"
    by_one, by_two = run_dic(*words, "--workers", 1, "-o", one), run_dic(*words, "--workers", 2, "-o", two)
    assert (by_one.status, by_two.status) == (2, 2)
    assert "img04.png" in by_one.err
    assert "img07.png: read image" in by_one.err
    assert (by_one.out, by_one.err) == (by_two.out, by_two.err)
    assert results(one) == results(two)


def test_number_of_workers_is_checked(images):
    assert "a number of processes, at least 1, got 0; give --workers 2" in refusal(
        "correlate", images, "--workers", 0
    )


@pytest.mark.long
def test_run_has_the_same_bits_by_processes_of_their_own(tmp_path):
    run = write_rendered_run(tmp_path / "run.h5", [slid(0.05 * number) for number in range(1, 12)])
    files = [tmp_path / f"{name}.h5" for name in ("threads", "one", "two")]
    for file, options in zip(files, ((), ("--workers", 1), ("--workers", 2)), strict=True):
        assert run_dic("process", run, "--step", 30, *options, "-o", file).status == 0
    assert results(files[0]) == results(files[1]) == results(files[2])


@pytest.mark.long
def test_kills_at_random_moments_and_other_numbers_of_workers_change_no_bit(images, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["correlate", str(images), "--subset", "21", "--step", "3", "-o", "r.h5"]
    begin = "import sys; from dic.cli import main; sys.argv[0] = 'dic'; main()"
    rng, result = random.Random(7), "r.h5"

    def start(workers):
        command = [sys.executable, "-c", begin, *words, "--workers", str(workers)]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    started = time.perf_counter()
    start(2).wait()
    took_s, whole = time.perf_counter() - started, results(tmp_path / result)
    (tmp_path / result).unlink()
    kills = 0
    while kills < 5:
        program = start(rng.choice((1, 2, 3)))
        try:
            program.wait(rng.uniform(0.4, 0.9) * took_s)
        except subprocess.TimeoutExpired:
            os.kill(program.pid, signal.SIGKILL)
            program.wait()
            kills += 1
            continue
        assert results(tmp_path / result) == whole
        (tmp_path / result).unlink()
    start(2).wait()
    assert results(tmp_path / result) == whole
