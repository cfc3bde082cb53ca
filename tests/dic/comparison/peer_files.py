"""Result files in the formats of other programs, for one motion that is known at all points.

The motion is affine, so bilinear interpolation of its displacements is exact. The axes are those of the
image: x to the right and y down.
"""

from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

GRADIENT = np.array([[0.004, 0.0015], [-0.0025, -0.002]])
"""The displacement gradient [[u_x, u_y], [v_x, v_y]], in axes with y down."""
SHIFT = np.array([1.25, -0.5])
STRAIN = (GRADIENT + GRADIENT.T + GRADIENT.T @ GRADIENT) / 2
"""The Green-Lagrange strain of the motion."""
SMALL = (GRADIENT + GRADIENT.T) / 2
OFFSET = np.array([0.03, -0.02])
"""Error of all displacements in the other program's file, px."""


def motion(x, y) -> tuple[np.ndarray, np.ndarray]:
    """Return the displacements in the other program's file, including `OFFSET`, at places in the image."""
    moved = SHIFT[:, None] + GRADIENT @ np.stack([np.ravel(x), np.ravel(y)]) + OFFSET[:, None]
    return moved[0].reshape(np.shape(x)), moved[1].reshape(np.shape(x))


def points() -> tuple[np.ndarray, np.ndarray]:
    """Return points between the points of the measurement, and one point outside the measurement."""
    x, y = np.meshgrid([43.0, 47.5, 60.0], [41.0, 58.0, 71.25])
    return np.append(x.ravel(), 300.0), np.append(y.ravel(), 20.0)


def write_dice(path: Path, separator: str = ",", heading: str = "") -> Path:
    """Write a result file of DICe. One of its points failed and has a SIGMA of -1."""
    x, y = points()
    u, v = motion(x, y)
    ones = np.ones_like(x)
    columns = {
        "COORDINATE_X": x, "COORDINATE_Y": y, "DISPLACEMENT_X": u, "DISPLACEMENT_Y": v, "SIGMA": 0.004 * ones,
        "VSG_STRAIN_XX": STRAIN[0, 0] * ones, "VSG_STRAIN_YY": STRAIN[1, 1] * ones,
        "VSG_STRAIN_XY": STRAIN[0, 1] * ones,
    }  # fmt: skip
    lines = [separator.join(f"{value:.10E}" for value in row) for row in zip(*columns.values(), strict=True)]
    failed = separator.join("-1.0E+00" if name == "SIGMA" else "5.0E+01" for name in columns)
    comments = ["***", "*** Deformed image: images/def.tif", heading or "*** Incremental correlation: false"]
    path.write_text("\n".join([*comments, separator.join(columns), *lines, failed]) + "\n")
    return path


def write_opencorr(path: Path) -> Path:
    """Write a result file of OpenCorr, with a separator at the end of each line, and one failed point."""
    x, y = points()
    u, v = motion(x, y)
    lines = ["x,y,u0,v0,u,v,exx,eyy,exy,zncc,iteration,convergence,feature,"]
    for row in zip(x, y, u, v, strict=True):
        strain = SMALL[0, 0], SMALL[1, 1], SMALL[0, 1]
        values = (*row[:2], 0.0, 0.0, *row[2:], *strain, 0.99, 4.0, 0.0005, 20.0)
        lines.append("".join(f"{value:.10f}," for value in values))
    lines.append("50.0,50.0," + "0.0," * 7 + "-3.0,0.0,0.0,0.0,")
    path.write_text("\n".join(lines) + "\n")
    return path


SPACING = 4
MM_PER_PX = 0.02


def _ncorr() -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, float]]:
    """Return Ncorr's tables of displacements, strains and dispinfo, with a point at every fifth pixel."""
    y, x = np.mgrid[0:20, 0:22] * (SPACING + 1.0)
    u, v = motion(x, y)
    inside = (x >= 40) & (x <= 75) & (y >= 40) & (y <= 75)
    displacements = {"plot_u_ref_formatted": u * MM_PER_PX, "plot_v_ref_formatted": v * MM_PER_PX}
    parts = {"exx": STRAIN[0, 0], "eyy": STRAIN[1, 1], "exy": STRAIN[0, 1]}
    strains = {f"plot_{name}_ref_formatted": np.full_like(x, value) for name, value in parts.items()}
    masked = (
        {key: np.where(inside, each, 0.0) for key, each in some.items()} for some in (displacements, strains)
    )
    return (*masked, {"spacing": float(SPACING), "pixtounits": MM_PER_PX})


def write_ncorr(path: Path, images: int = 2, lens: float = 0.0) -> Path:
    """Write a MATLAB file of version 5 from Ncorr; the images before the last have twice the motion."""
    displacements, strains, info = _ncorr()
    twice = {name: 2 * values for name, values in displacements.items()}
    several = [twice] * (images - 1) + [displacements]
    info = info | {"lenscoef": lens}
    root = {"displacements": np.array(several), "strains": np.array([strains] * images), "dispinfo": info}
    savemat(path, {"data_dic_save": root}, long_field_names=True)
    return path


def write_ncorr_73(path: Path, images: int = 2, lens: float = 0.0, *, formatted: bool = True) -> Path:
    """Write a MATLAB file of version 7.3 as Ncorr saves it: HDF5 behind 512 bytes, images as `write_ncorr`.

    A structure of one element has its values as members. A structure of several elements has references to
    values in the group `#refs#`. Dimensions are in reverse order. Masks are objects of MATLAB, with numbers
    that only MATLAB understands.
    """
    displacements, strains, info = _ncorr()
    twice = {name: 2 * values for name, values in displacements.items()}
    with h5py.File(path, "w", userblock_size=512) as file:
        root = file.create_group("data_dic_save")
        for group, several in (
            ("displacements", [twice] * (images - 1) + [displacements]),
            ("strains", [strains] * images),
        ):
            place = root.create_group(group)
            place.attrs["MATLAB_class"] = np.bytes_("struct")
            for name in several[0]:
                values = [each[name].T for each in several]
                if not formatted:
                    empty = place.create_dataset(name, data=np.zeros(2, np.uint64))
                    empty.attrs["MATLAB_empty"] = np.uint8(1)
                elif images == 1:
                    place[name] = values[0]
                else:
                    kept = [f"#refs#/{group}{name}{k}" for k in range(images)]
                    for target, each in zip(kept, values, strict=True):
                        file.create_dataset(target, data=each, compression="gzip", shuffle=True)
                    references = [[file[target].ref] for target in kept]
                    place.create_dataset(name, data=references, dtype=h5py.ref_dtype)
            mask = place.create_dataset("roi_ref_formatted", data=np.full((1, 6), 3707764736, np.uint32))
            mask.attrs["MATLAB_object_decode"] = np.int32(3)
        for name, value in (info | {"lenscoef": lens}).items():
            root[f"dispinfo/{name}"] = [[value]]
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    return path
