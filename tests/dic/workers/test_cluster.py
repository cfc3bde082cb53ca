"""Workers of a Dask cluster: refused in one sentence where they are missing, and lost ones change nothing."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

import pytest

from dic.errors import WorkerError
from dic.pipeline.result_file import load_series_result
from dic.pipeline.result_writer import MeasurementWriter
from dic.pipeline.series_image import FileDigests
from dic.workers.cluster import _Answer, open_to_others
from tests.command_line import refusal, run_dic
from tests.dic.result_values import results
from tests.image_files import write_image


def test_missing_dask_is_named_with_the_command_that_installs_it(tmp_path, speckle, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for number in range(2):
        write_image(tmp_path / f"img{number}.png", speckle(seed=21, shape=(60, 60)).draw())
    words = ("correlate", tmp_path, "--scheduler", "tcp://localhost:8786")
    assert "pip install 'offaxis[cluster]'" in refusal(*words)
    assert "--workers or --scheduler, got both" in refusal(*words, "--workers", 2)


@pytest.mark.parametrize(
    ("address", "is_open"),
    [
        ("tcp://127.0.0.1:8786", False),
        ("tcp://[::1]:8786", False),
        ("tcp://localhost:8786", False),
        ("tls://192.168.1.5:8786", False),
        ("tcp://192.168.1.5:8786", True),
        ("tcp://0.0.0.0:8786", True),
        ("ws://lab-server:8786", True),
    ],
)
def test_scheduler_that_others_can_use_is_told_from_one_that_they_cannot(address, is_open):
    assert open_to_others(address) is is_open


class Cluster:
    """A scheduler and two workers as programs of their own, the workers in a folder of their own."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._folder = stack, folder
        words = ("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.scheduler = scheduler = self._start(*words)
        assert scheduler.stderr is not None
        self.address = next(
            line.split()[-1] for line in scheduler.stderr if "Scheduler at:" in line and "tcp://" in line
        )
        worker = ("dask_worker", self.address, "--no-nanny", "--nthreads", "1", "--no-dashboard")
        self.workers = [self._start(*worker) for _ in range(2)]

    def _start(self, module: str, *words: str) -> "Popen[str]":
        command = [sys.executable, "-m", f"distributed.cli.{module}", *words]
        root = str(Path(__file__).parents[3])
        errors = PIPE if module == "dask_scheduler" else DEVNULL
        program = Popen(
            command, stdout=DEVNULL, stderr=errors, text=True, cwd=self._folder,
            env=os.environ | {"PYTHONPATH": root},
        )  # fmt: skip
        self._stack.enter_context(program)
        self._stack.callback(program.kill)
        return program


@pytest.fixture
def cluster(tmp_path_factory) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="offaxis[cluster] is not installed")
    with ExitStack() as stack:
        yield Cluster(stack, tmp_path_factory.mktemp("elsewhere"))


@pytest.fixture(scope="module")
def images(speckle, tmp_path_factory):
    """A reference and sixteen images, one of which shows something else."""
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21, shape=(160, 160))
    for number in range(17):
        shown = speckle(seed=99, shape=(160, 160)) if number == 4 else pattern
        write_image(folder / f"img{number:02d}.png", shown.draw(lambda x, y, by=0.37 * number: (x - by, y)))
    return folder


@pytest.mark.long
def test_worker_that_is_killed_half_way_changes_no_bit(cluster, images, tmp_path, monkeypatch):
    monkeypatch.chdir(images.parent)
    alone, shared = tmp_path / "alone.h5", tmp_path / "shared.h5"
    words = ("correlate", images.name, "--subset", 21, "--step", 3)
    by_one = run_dic(*words, "--workers", 1, "-o", alone)
    add, added = MeasurementWriter.add_field, []

    def killing(self: MeasurementWriter, *given: object) -> None:
        add(self, *given)
        added.append(given)
        if len(added) == 7:
            cluster.workers[0].send_signal(signal.SIGKILL)

    monkeypatch.setattr(MeasurementWriter, "add_field", killing)
    by_cluster = run_dic(*words, "--scheduler", cluster.address, "-o", shared)
    assert cluster.workers[0].wait() == -signal.SIGKILL
    assert (by_cluster.status, by_cluster.out) == (by_one.status, by_one.out)
    assert results(shared) == results(alone)


@pytest.mark.long
def test_worker_with_another_file_or_other_versions_ends_the_command(cluster, images, tmp_path):
    words = ("correlate", images, "--subset", 21, "--scheduler", cluster.address)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FileDigests, "of", lambda *_: "0" * 64)
        said = refusal(*words)
        assert "expected the image that the command reads, got another one; give all workers the same" in said
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dic.pipeline.image_task.own_versions", lambda: "offaxis 0.0")
        assert "compare versions: expected offaxis 0.0, got offaxis" in refusal(*words)


@pytest.fixture
def answer() -> Callable[[], tuple[Future[int], Future[int]]]:
    """A function that returns a task of a cluster's client and the answer to it."""

    def give() -> tuple[Future[int], Future[int]]:
        begun: Future[int] = Future()
        return begun, _Answer(begun, "tcp://there")

    return give


def test_task_that_the_scheduler_withdraws_is_one_sentence_and_no_cancellation(answer):
    begun, given = answer()
    begun.cancel()
    with pytest.raises(WorkerError, match="the scheduler has ended; start the scheduler"):
        given.result(0)


def test_answer_that_comes_while_it_is_withdrawn_raises_nothing(answer, caplog):
    begun, given = answer()
    # The task cannot be withdrawn any more, and ends just after the answer was withdrawn.
    begun.set_running_or_notify_cancel()
    assert given.cancel()
    begun.set_result(1)
    assert given.cancelled()
    begun, given = answer()
    assert given.cancel()
    assert begun.cancelled()
    begun, given = answer()
    begun.set_result(3)
    assert (given.cancel(), given.result(0)) == (False, 3)
    assert not caplog.records


@pytest.mark.long
def test_end_of_the_scheduler_ends_the_command_and_keeps_the_finished_images(
    cluster, images, tmp_path, monkeypatch
):
    add, added = MeasurementWriter.add_field, []

    def killing(self: MeasurementWriter, *given: object) -> None:
        add(self, *given)
        added.append(given)
        if len(added) == 4:
            cluster.scheduler.send_signal(signal.SIGKILL)

    monkeypatch.setattr(MeasurementWriter, "add_field", killing)
    result = tmp_path / "r.h5"
    words = ("correlate", images, "--subset", 21, "--step", 3, "-o", result)
    ended = run_dic(*words, "--scheduler", cluster.address)
    assert ended.status == 2
    assert ended.err.splitlines()[-1].endswith("and give the same command to go on")
    monkeypatch.setattr(MeasurementWriter, "add_field", add)
    assert len(load_series_result(result).images) >= 4
    assert run_dic(*words, "--workers", 1).status == 2
    assert load_series_result(result).finished
