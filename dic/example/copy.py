"""Write the example measurement to a folder."""

from importlib import resources
from pathlib import Path

from dic.files.writing import replacing
from dic.typing import PathLike

FILES = {
    "grid.png": "calibration grid in the specimen's place: 21 x 21 lines, 0.5 mm apart",
    "reference.png": "the specimen at rest, seen by a camera 30° off-axis",
    **{f"step-{number:02}.png": "" for number in range(1, 17)},
    "mask.png": "the region of the specimen, for --roi",
    "machine.csv": "time, load and crosshead displacement at each image",
    "known.json": "the true modulus, Poisson's ratio and proof strength, for `dic report --known`",
    "truth.json": "the true strains, and the specimen's section and elastic constants",
}
"""Name and description of each file of the example; all images under load have the same description."""


def example_places(folder: PathLike) -> list[Path]:
    """Return the paths of all files that `write_example` writes to a folder."""
    return [Path(folder) / name for name in FILES]


def write_example(folder: PathLike) -> list[Path]:
    """Write a small tension test to a folder, for first trials.

    The images show a narrow aluminium specimen that is pulled in 16 steps, until it yields. As the grips
    straighten the specimen, it tilts by up to 0.08°. The camera looks at the specimen 30° off-axis, so the
    tilt causes a false strain. The virtual rig has made the images (`examples/draw_series.py`), so the true
    strains are known.

    Parameters
    ----------
    folder : path
        The folder is made if it does not exist. Existing files of the same names are replaced.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OSError
        If the folder or a file cannot be written.
    """
    source = resources.files("dic.example") / "files"
    places = example_places(folder)
    Path(folder).mkdir(parents=True, exist_ok=True)
    for place in places:
        with replacing(place) as partial:
            partial.write_bytes((source / place.name).read_bytes())
    return places
