"""Run the paper's experiments on virtual rigs, from protocol to report, for the command `rig demo`."""

import shutil
import sysconfig
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rig import Aborted, RigError, run_protocol

if TYPE_CHECKING:
    from dic.pipeline.run_result import RunResult

EXPERIMENTS = {
    "tension": ("tension.toml", "rig-virtual-tension.toml"),
    "rotation-10": ("rotation.toml", "rig-virtual-rotation-10.toml"),
    "rotation-20": ("rotation.toml", "rig-virtual-rotation-20.toml"),
    "rotation-30": ("rotation.toml", "rig-virtual-rotation-30.toml"),
}
"""The name of each demo run, with its protocol file and its rig file from the folder of examples."""

_MARK = ".offaxis-demo"


@dataclass(frozen=True)
class Demo:
    """The files that a demo writes: a run file and a result file per experiment, and one report."""

    folder: Path
    runs: dict[str, Path]
    results: dict[str, Path]
    report: Path


def examples_folder() -> Path:
    """Return the folder of the example protocols and rig files, in the checkout or in the installation."""
    checkout = Path(__file__).parents[2] / "examples"
    installed = Path(sysconfig.get_path("data")) / "share" / "offaxis" / "examples"
    for folder in (checkout, installed):
        if (folder / "tension.toml").is_file():
            return folder
    raise RigError("the examples", f"protocols in {installed}", "none", "install offaxis again")


def run_demo(folder: Path, say: Callable[[str], None]) -> Demo:
    """Run the paper's experiments on virtual rigs, measure their images and write the report.

    While one experiment runs, a second thread measures the images of the previous experiment.

    Parameters
    ----------
    folder : Path
        A new folder, an empty folder, or the folder of an earlier demo. Files of an earlier demo are
        replaced.
    say : callable
        Prints one line of progress. A second thread also calls this function.

    Raises
    ------
    RigError, DeviceError, ConfigurationError, MeasurementError
        If the folder has other files, or an experiment cannot be run or measured.
    """
    from dic.report import write_report

    _make_folder(folder)
    source = examples_folder()
    demo = Demo(
        folder,
        {name: folder / f"{name}.h5" for name in EXPERIMENTS},
        {name: folder / f"{name}.results.h5" for name in EXPERIMENTS},
        folder / "report.html",
    )
    for path in (*demo.runs.values(), *demo.results.values(), demo.report):
        path.unlink(missing_ok=True)
    pending: list[Future[RunResult]] = []
    with ThreadPoolExecutor(1) as pool:
        try:
            for name, files in EXPERIMENTS.items():
                _run(name, source, files, demo, say)
                pending.append(pool.submit(_measure, name, demo, say))
            results = [task.result() for task in pending]
        except BaseException:
            # Without `shutdown`, the pool would finish all pending measurements before the error is raised.
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    say("writing the report")
    write_report(results, demo.report)
    return demo


def _run(name: str, source: Path, files: tuple[str, str], demo: Demo, say: Callable[[str], None]) -> None:
    protocol, rig = (Path(shutil.copy(source / file, demo.folder)) for file in files)
    say(f"{name}: running {protocol} on {rig}")
    outcome = run_protocol(protocol, rig, demo.runs[name])
    if outcome.status != "completed":
        raise Aborted(name, "a completed run", outcome.status, f"see: {outcome.reason}")
    say(f"{name}: {outcome.steps_done} steps in {demo.runs[name]}")


def _make_folder(folder: Path) -> None:
    """Make the folder. Refuse a folder with other files, because real runs may have the same file names."""
    mark = folder / _MARK
    try:
        if folder.is_dir() and any(folder.iterdir()) and not mark.exists():
            raise RigError(
                str(folder),
                "a new or empty folder, or that of an earlier demo",
                "one with other files, which the demo could replace",
                "name another folder with -o",
            )
        folder.mkdir(parents=True, exist_ok=True)
        mark.touch()
    except OSError as error:
        raise RigError(
            str(folder),
            "a folder that can be written to",
            error.strerror or str(error),
            "name another folder with -o",
        ) from error


def _measure(name: str, demo: Demo, say: Callable[[str], None]) -> "RunResult":
    from dic.pipeline.run import process_run

    result = process_run(demo.runs[name], output=demo.results[name])
    images = sum(len(camera.measurements) for camera in result.cameras)
    say(f"{name}: measured {images} images into {demo.results[name]}")
    return result
