"""Export as text in DICe's format, for programs that read DICe's solution files.

DICe (dicengine on GitHub, `DICe_Schema.cpp` and the solution files of its tests) writes comment lines that
begin with three stars, one line with the names of the columns, and one line per subset. DICe uses the axes of
the image: x to the right, y downwards. In these axes the shear strain has the opposite sign.
"""

import numpy as np

from dic.exports.image import Exporter, ExportImage, file_name
from dic.files.writing import replacing
from dic.results.points import RAW

_COLUMNS = (
    "COORDINATE_X", "COORDINATE_Y", "DISPLACEMENT_X", "DISPLACEMENT_Y", "VSG_STRAIN_XX", "VSG_STRAIN_YY",
    "VSG_STRAIN_XY", "SIGMA", "GAMMA",
)  # fmt: skip


class DiceExporter(Exporter):
    """Writes one file per image, with only the points that have a displacement.

    SIGMA is the larger one of the standard deviations of u and v, px, as in DICe. GAMMA is the minimum of the
    zero-normalised sum of squared differences, which equals 2 (1 - ZNCC).
    """

    def add(self, image: ExportImage) -> None:
        """Write an image."""
        points, values = image.points, image.points.values
        x_px, y_px = np.meshgrid(points.x_px, points.y_px)
        sigma = np.fmax(values["std_u_px"], values["std_v_px"])
        own = _prefix(image)
        strains = values[f"{own}exx"], values[f"{own}eyy"], -values[f"{own}exy"]
        places = x_px, y_px, values["u_px"], values["v_px"]
        # A negative value would count as a failed point; rounding alone makes a ZNCC larger than 1.
        gamma = np.maximum(2.0 * (1.0 - values["zncc"]), 0.0)
        table = np.stack([*places, *strains, sigma, gamma], axis=-1)[points.converged]
        digits = len(str(self.series.count))
        folder = self.folder / file_name(self.series.camera)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"DICe_solution_{image.number:0{digits}d}.txt"
        with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(f"*** {line}\n" if line else "***\n" for line in self._heading(image))
            file.write(",".join(_COLUMNS) + "\n")
            np.savetxt(file, table, fmt="%.10e", delimiter=",")

    def _heading(self, image: ExportImage) -> list[str]:
        about = self.series.about
        kind = "raw" if _prefix(image) else image.points.strain_kind
        return [
            "",
            f"Written by {about.get('versions', 'offaxis')}, in the columns of DICe",
            f"Deformed image: {image.points.label}",
            f"Subset size: {about['subset_px']:g}",
            f"Step size: x {about['step_px']:g} y {about['step_px']:g}",
            f"Strain window size in pixels: {about['strain_gauge_px']:g}",
            f"Strain: {about['strain_measure']}, {kind}; SIGMA: standard deviation, px; GAMMA: 2 (1 - ZNCC)",
            "Coordinates given with (0,0) as upper left corner of image, x positive right, y positive down",
            "",
        ]


def _prefix(image: ExportImage) -> str:
    """Return the beginning of the names of the strains: that of raw strains if the export has them."""
    return RAW if f"{RAW}exx" in image.points.values else ""
