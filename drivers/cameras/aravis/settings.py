"""Rig-file settings of a GigE Vision or USB3 Vision camera."""

from pydantic import Field

from drivers.cameras.genicam.settings import GenicamSettings


class AravisSettings(GenicamSettings):
    """Settings of a camera.

    `camera` is the network address of the camera, or its identifier as printed by ``arv-tool-0.8``
    (``Maker-SERIAL``).
    """

    exposure_us: float = Field(gt=0)
