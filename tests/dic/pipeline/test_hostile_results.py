"""Each damaged or malicious result file or calibration file is refused with one sentence."""

import random
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.errors import RunFileError
from dic.pipeline.result_file import load_run_result
from dic.pipeline.result_writer import save_run_result
from tests.command_line import refusal, run_dic
from tests.dic.report.page import leave_undrawn
from tests.dic.report.runs import tension_run

SERIES = "cameras/on_axis/series"
Change = Callable[[h5py.File], None]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("results") / "r.h5"
    save_run_result(tension_run(), path)
    return path


def _external(file: h5py.File) -> None:
    del file[f"{SERIES}/x_px"]
    file.create_dataset(f"{SERIES}/x_px", (8,), "i8", external=[("/etc/passwd", 0, 64)])


def _replaced(path: str, **options: object) -> Change:
    def change(file: h5py.File) -> None:
        del file[path]
        file.create_dataset(path, **options)

    return change


def _linked(path: str, link: object) -> Change:
    def change(file: h5py.File) -> None:
        del file[path]
        file[path] = link

    return change


def _circle(file: h5py.File) -> None:
    file["cameras/again"] = file["/"]


HOSTILE: dict[str, Change] = {
    "storage in another file": _external,
    "a link to another file": _linked("cameras/on_axis", h5py.ExternalLink("/etc/hosts", "/x")),
    "a soft link": _linked("cameras/on_axis", h5py.SoftLink("/cameras/off_axis")),
    "a link to itself": _linked("cameras/on_axis", h5py.SoftLink("/cameras/on_axis")),
    "a circle": _circle,
    "eight tebibytes": _replaced(f"{SERIES}/u_px", shape=(4, 1 << 20, 1 << 18), dtype="f8", chunks=(1, 8, 8)),
    "maps of another size": _replaced(f"{SERIES}/u_px", data=np.zeros((4, 3, 5))),
    "texts for numbers": _replaced(f"{SERIES}/zncc", data=["a", "b"], dtype=h5py.string_dtype()),
    "no strain": lambda file: file[SERIES].__delitem__("exx"),
    "numbers that are none": lambda file: file["run"].attrs.update(thickness_mm=[1, 2]),
    "a camera without anything": lambda file: file.create_group("cameras/third"),
    "a reference of no size": _replaced("cameras/on_axis/reference", shape=(0, 0), dtype="f4"),
}


def changed(good: Path, path: Path, change: Change) -> Path:
    path.write_bytes(good.read_bytes())
    with h5py.File(path, "r+") as file:
        change(file)
    return path


@pytest.mark.parametrize("drawn", [False, pytest.param(True, marks=pytest.mark.extended)])
def test_the_results_that_are_changed_here_are_good(
    good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: bool
) -> None:
    if not drawn:
        leave_undrawn(monkeypatch)
    assert run_dic("report", good, "-o", tmp_path / "report.html").status == 0


@pytest.mark.parametrize("harm", HOSTILE)
def test_hostile_results_are_one_sentence(good: Path, tmp_path: Path, harm: str) -> None:
    results, page = changed(good, tmp_path / "r.h5", HOSTILE[harm]), tmp_path / "report.html"
    assert str(results) in refusal("report", results, "-o", page)
    assert not page.exists()


def _shortened(path: str) -> Change:
    """Return the change that removes the last row and the last column of each map of a dataset."""

    def change(file: h5py.File) -> None:
        values = file[path][:]
        cut = values[:, :-1, :-1] if values.ndim > 2 else values[:-1, :-1]
        del file[path]
        file[path] = cut

    return change


MAPS = (
    "exx", "eyy", "exy", "exx_std", "eyy_std", "exy_std", "std_u_px", "zncc",
    "gradient", "status", "U_mm", "X_mm", "active",
)  # fmt: skip


@pytest.mark.parametrize("name", MAPS)
def test_a_map_that_does_not_fit_the_points_is_named(good: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(
        RunFileError, match=rf"{SERIES}/{name} has 7 × 7 values for 8 × 8 points; make it with"
    ):
        load_run_result(changed(good, tmp_path / "r.h5", _shortened(f"{SERIES}/{name}")))


@pytest.mark.parametrize("group", [f"{SERIES}/corrected", "both/on_axis/corrected"])
def test_a_corrected_map_that_does_not_fit_the_points_is_named(
    good: Path, tmp_path: Path, group: str
) -> None:
    def change(file: h5py.File) -> None:
        file[f"{group}/eyy"] = np.zeros((4, 7, 8))

    with pytest.raises(RunFileError, match=f"{group}/eyy has 7 × 8 values for 8 × 8 points"):
        load_run_result(changed(good, tmp_path / "r.h5", change))


@pytest.mark.parametrize("path", ["cameras/on_axis/reference", f"{SERIES}/region"])
def test_a_region_of_another_size_than_the_reference_is_named(good: Path, tmp_path: Path, path: str) -> None:
    def change(file: h5py.File) -> None:
        file[f"{SERIES}/region"] = np.ones(file["cameras/on_axis/reference"].shape, np.uint8)
        _shortened(path)(file)

    with pytest.raises(RunFileError, match=f"{SERIES}/region has .* values for .* pixels of the reference"):
        load_run_result(changed(good, tmp_path / "r.h5", change))


def check_a_flipped_byte(good: Path, folder: Path, rng: random.Random) -> None:
    """Check that a result file with a changed byte is read, or refused with one sentence.

    Result files have no digest, so not every change can be noticed.
    """
    content = bytearray(good.read_bytes())
    content[rng.randrange(len(content))] ^= rng.randrange(1, 256)
    (folder / "r.h5").write_bytes(content)
    try:
        load_run_result(folder / "r.h5")
    except RunFileError as error:
        assert "\n" not in str(error)  # noqa: PT017


def test_flipped_bytes_give_no_traceback(good: Path, tmp_path: Path) -> None:
    rng = random.Random(1)
    for _ in range(8):
        check_a_flipped_byte(good, tmp_path, rng)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_thousand_flipped_bytes_give_no_traceback(good: Path, tmp_path: Path) -> None:
    rng = random.Random(2)
    for _ in range(1000):
        check_a_flipped_byte(good, tmp_path, rng)
