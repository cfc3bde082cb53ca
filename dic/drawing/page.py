"""Write the page on which a person draws regions and gauges over an image."""

import html
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from string import Template

from dic.calibration.calibration import Calibration
from dic.drawing.millimetres import calibration_nodes
from dic.drawing.picture import shown_picture
from dic.drawing.shapes import gauge_shapes, kept_gauges, region_shapes
from dic.files.writing import write_text
from dic.gauges.declared import Gauge
from dic.image.given import grey_image, name_of
from dic.typing import ImageLike, Mask, PathLike

REGION_FILE, GAUGES_FILE = "region.toml", "gauges.toml"
"""Names under which the browser saves the region and the gauges."""

_SCRIPTS = (
    "konva.min.js", "geometry.js", "kinds.js", "model.js", "files.js", "view.js", "tools.js", "panel.js",
    "start.js",
)  # fmt: skip
"""The scripts of the page in their order: Konva draws, and the others are offaxis' own."""


def write_drawing_page(
    image: ImageLike,
    path: PathLike,
    *,
    region: Mask | PathLike | None = None,
    gauges: Sequence[Gauge] = (),
    calibration: Calibration | None = None,
    name: str | None = None,
) -> None:
    """Write one HTML file on which regions, cracks and gauges are drawn over an image, in any browser.

    The page contains the image and all scripts, so it needs no network and no other file. The page saves the
    region as a region file, for ``--roi``, and the gauges as TOML, for `read_gauges`.

    Parameters
    ----------
    image : ndarray, shape (height, width), or path
        The reference image. Coordinates refer to the whole image, even if the page shows fewer pixels.
    path : path
        The HTML file to write. An existing file is replaced.
    region : ndarray of bool, shape (height, width), or path, optional
        A region to begin with: a mask, a mask image or a region file.
    gauges : sequence of Gauge, optional
        Gauges to begin with. Gauges in mm are shown and written again, but cannot be changed.
    calibration : Calibration, optional
        The page then also shows the pointer's place in mm.
    name : str, optional
        Name of the image in the title of the page and in the saved files. Default: the name of the image
        file.

    Raises
    ------
    MeasurementError
        If the image or the region cannot be used, or if a gauge lies outside the image.
    OSError
        If the file cannot be written.
    """
    grey = grey_image(image, "image")
    # The name stands in a comment of the files that the page saves, which ends at a line break.
    shown = Path(name_of(image, "image")).name if name is None else name
    title = "".join(sign if sign.isprintable() else "?" for sign in shown)
    shapes = [] if region is None else region_shapes(region, grey.shape)
    shapes += gauge_shapes(gauges, grey.shape)
    uri, reduction = shown_picture(grey)
    data = {
        "name": title,
        "width": grey.shape[1],
        "height": grey.shape[0],
        "picture": uri,
        "reduction": reduction,
        "shapes": shapes,
        "kept": kept_gauges(gauges, calibration),
        "calibration": None if calibration is None else calibration_nodes(calibration),
        "files": {"region": REGION_FILE, "gauges": GAUGES_FILE},
    }
    write_text(path, _page(title, data))


def _page(name: str, data: dict[str, object]) -> str:
    assets = resources.files("dic.drawing") / "assets"
    scripts = [(assets / script).read_text(encoding="utf-8") for script in _SCRIPTS]
    return Template((assets / "page.html").read_text(encoding="utf-8")).substitute(
        title=html.escape(f"Regions and gauges on {name}"),
        name=html.escape(name),
        region_file=REGION_FILE,
        gauges_file=GAUGES_FILE,
        style=(assets / "page.css").read_text(encoding="utf-8"),
        # A browser ends a script at the next "</", also within a text of JSON.
        data=json.dumps(data, allow_nan=False).replace("</", "<\\/"),
        scripts="\n".join(f"<script>\n{script}\n</script>" for script in scripts),
    )
