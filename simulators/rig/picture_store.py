"""Prepared pictures in a folder that the user names, so that a second run needs no preparation."""

import os
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from drivers.errors import DeviceFault
from simulators.scene.optics import PinholeCamera
from simulators.scene.prepared import PER_PIXEL, PreparedPicture, points_of
from simulators.scene.scene import Surface
from simulators.scene.texture import Speckle, Texture

_VERSION = 1
"""Part of each name: raise it when the same texture, camera and surface give another picture."""


@dataclass(frozen=True)
class PictureStore:
    """A folder with one file for each prepared picture. Its name depends on everything that is drawn."""

    folder: Path

    def load(self, camera: PinholeCamera, surface: Surface, margin_px: int) -> PreparedPicture | None:
        """Return the picture of a surface, None if there is none, or none that can be read."""
        with suppress(OSError, ValueError, EOFError):
            fine = np.load(self._path(camera, surface, margin_px), allow_pickle=False)
            if fine.shape == points_of(camera, margin_px) and fine.dtype == np.uint8:
                return PreparedPicture(camera, surface, margin_px, fine)
        return None

    def keep(self, picture: PreparedPicture) -> None:
        """Write a picture to the folder. Raise `DeviceFault` if that is not possible."""
        path = self._path(picture.camera, picture.surface, picture.margin_px)
        unfinished = path.with_suffix(f".{os.getpid()}")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with unfinished.open("wb") as file:
                np.save(file, picture.fine)
            unfinished.replace(path)
        except OSError as error:
            with suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise DeviceFault(
                "simulation",
                "keep a prepared picture",
                f"room in a folder that can be written, {self.folder}",
                str(error),
                "name another folder in [simulation.prepared], or leave it out",
            ) from error

    def _path(self, camera: PinholeCamera, surface: Surface, margin_px: int) -> Path:
        drawn = sha256(f"{_VERSION} {PER_PIXEL} {camera} {margin_px} ".encode())
        drawn.update(_identity(surface.texture))
        pose = surface.pose
        for values in (pose.rotation, pose.translation_mm, surface.deformation_gradient, surface.shift_mm):
            drawn.update(np.ascontiguousarray(values, np.float64).tobytes())
        return self.folder / f"picture-{drawn.hexdigest()[:24]}.npy"


def _identity(texture: Texture) -> bytes:
    """Return bytes that differ for different textures."""
    if isinstance(texture, Speckle):
        return b"speckle" + texture.dots.tobytes() + repr(texture.cell_mm).encode()
    return repr(texture).encode()
