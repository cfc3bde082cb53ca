"""Run the paper's experiments, a tensile test and a continuous one on virtual rigs, for `rig demo`."""

import shutil
import sysconfig
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rig import Aborted, RigError, read_protocol, read_rig, run_protocol
from rig.protocol.protocol import live_table_of

if TYPE_CHECKING:
    from dic.pipeline.result import RunResult
    from dic.report import TensileTest

EXPERIMENTS = {
    "tension": ("tension.toml", "rig-virtual-tension.toml"),
    "rotation-10": ("rotation.toml", "rig-virtual-rotation-10.toml"),
    "rotation-20": ("rotation.toml", "rig-virtual-rotation-20.toml"),
    "rotation-30": ("rotation.toml", "rig-virtual-rotation-30.toml"),
    "tensile": ("tensile.toml", "rig-virtual-tensile.toml"),
    "continuous": ("continuous.toml", "rig-virtual-pull.toml"),
}
"""The protocol file and the rig file of each demo run, from the folder of examples, by the run's name."""

_LIVE = "continuous"
"""The demo run whose live gauges are shown beside those that are measured from its images."""
_PROPERTIES = "tensile"
"""The demo run whose material properties are shown beside the exact ones."""
_MARK = ".offaxis-demo"


@dataclass(frozen=True)
class Demo:
    """The files that a demo writes: a run file and a result file per experiment, and one report.

    `properties` has a line for each material property, with its exact value, and `live` a line for each live
    gauge, beside its strain from the images; `curves` is their picture.
    """

    folder: Path
    runs: dict[str, Path]
    results: dict[str, Path]
    report: Path
    curves: Path
    properties: tuple[str, ...] = ()
    live: tuple[str, ...] = ()


def examples_folder() -> Path:
    """Return the folder of the example protocols and rig files, in the checkout or in the installation."""
    checkout = Path(__file__).parents[2] / "examples"
    installed = Path(sysconfig.get_path("data")) / "share" / "offaxis" / "examples"
    for folder in (checkout, installed):
        if (folder / "tension.toml").is_file():
            return folder
    raise RigError("the examples", f"protocols in {installed}", "none", "install offaxis again")


def run_demo(folder: Path, say: Callable[[str], None]) -> Demo:
    """Run the paper's experiments and a tensile test on virtual rigs, measure them and write the report.

    The live gauges of a continuous test are drawn beside the gauges from its images.
    The report ends its summary with the material properties of the tensile test beside the exact ones.

    While one experiment runs, a second thread measures the images of the previous experiment.

    `folder` is a new folder, an empty folder, or the folder of an earlier demo, whose files are replaced.
    `say` prints one line of progress. A second thread also calls this function. Raise `RigError`,
    `DeviceError`, `ConfigurationError` or `MeasurementError` if the folder has other files, or an experiment
    cannot be run or measured.
    """
    from dic.report import write_report

    _make_folder(folder)
    source = examples_folder()
    demo = Demo(
        folder,
        {name: folder / f"{name}.h5" for name in EXPERIMENTS},
        {name: folder / f"{name}.results.h5" for name in EXPERIMENTS},
        folder / "report.html",
        folder / f"{_LIVE}.png",
    )
    for path in (*demo.runs.values(), *demo.results.values(), demo.report, demo.curves):
        path.unlink(missing_ok=True)
    pending: list[Future[RunResult]] = []
    with ThreadPoolExecutor(1) as pool:
        try:
            for name, files in EXPERIMENTS.items():
                _run(name, source, files, demo, say)
                pending.append(pool.submit(_measure, name, demo, say))
            results = [task.result() for task in pending]
        except BaseException:
            # Cancel pending measurements. Otherwise the pool would finish them before the error is raised.
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    say("writing the report")
    by_name = dict(zip(EXPERIMENTS, results, strict=True))
    live = _beside_live(by_name.pop(_LIVE), demo)
    test = _tensile_test(by_name[_PROPERTIES], folder)
    write_report(list(by_name.values()), demo.report, tests=[test])
    return replace(demo, properties=tuple(_property_lines(test)), live=tuple(live))


def _beside_live(result: "RunResult", demo: Demo) -> list[str]:
    """Draw the live gauges beside the same gauges from the images, and return a line for each of them."""
    import numpy as np

    from dic import measure_gauges
    from dic.gauges import plot_gauges

    table = live_table_of(read_protocol(demo.folder / EXPERIMENTS[_LIVE][0]))
    assert table is not None
    series = measure_gauges(result, table.declared, camera=table.camera)
    plot_gauges(series, demo.curves, against="load", kinds=("corrected",))
    known = [image.known for image in series.images]
    lines = []
    for name in table.names:
        strain, std = series.strain(name, "corrected")
        live = series.channels[f"channels.gauge.{name}"].strain(known)
        both = np.isfinite(live) & np.isfinite(strain)
        off = (live - strain)[both]
        within = np.mean(np.abs(off) <= 2.0 * std[both])
        lines.append(
            f"live gauge {name}: {1e6 * np.sqrt(np.mean(off**2)):.1f} µε rms from its strain in {both.sum()} "
            f"images of {table.camera}, {within:.0%} within two standard deviations"
        )
    return lines


def _tensile_test(result: "RunResult", folder: Path) -> "TensileTest":
    """Return the tensile test with the exact properties of its virtual specimen.

    The measurement has no access to the exact properties: they come from the driver of the virtual rig.
    """
    from dic import measure_gauges, tensile_test
    from dic.derived import whole_field_gauges
    from dic.properties import PropertySettings

    gauges = whole_field_gauges(result)
    known = _exact_properties(folder / EXPERIMENTS[_PROPERTIES][1])
    settings = PropertySettings(area_mm2=result.info.width_mm * result.info.thickness_mm)
    along, across = (gauge.name for gauge in gauges)
    series = measure_gauges(result, gauges)
    return tensile_test(series, along, across, settings, known=known, title=result.info.title)


def _exact_properties(rig: Path) -> dict[str, float]:
    """Return the exact properties that the tensile test can give, from the virtual rig's driver."""
    simulation = read_rig(rig).simulation
    exact = None if simulation is None else simulation.setting("exact_properties")
    if exact is None:
        expected, remedy = "a virtual rig with exact properties", "install offaxis again"
        raise RigError(str(rig), expected, "none", remedy)
    return {name: float(exact()[name]) for name in ("E_gpa", "nu", "Rp02_mpa")}


def _property_lines(test: "TensileTest") -> list[str]:
    """Return a line of text for each known property: the value from each camera, and the exact value."""
    lines = []
    for name, exact in test.known.items():
        values = [(column.label, column.properties.values[name]) for column in test.columns]
        texts = [f"{value.value:.4g} ({label})" for label, value in values if value.value is not None]
        lines.append(f"{name}: {', '.join(texts)}; exact {exact:.4g}")
    return lines


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
