"""Rig-file settings of a camera that is reached through a GenTL producer."""

from typing import Annotated

from pydantic import BeforeValidator, Field

from drivers.cameras.genicam.settings import GenicamSettings


def _one_or_more(value: object) -> object:
    return [value] if isinstance(value, str) else value


class GentlSettings(GenicamSettings):
    """Settings of a camera.

    `camera` is its serial number, its model, its identifier or the name that its owner gave to it. It must
    name exactly one camera.
    """

    # GenTL producers (.cti files), or folders with them. Without this setting, the driver takes all producers
    # in the folders of the environment variable GENICAM_GENTL64_PATH, which makers' installers set.
    cti: Annotated[list[str], BeforeValidator(_one_or_more)] = Field(default_factory=list)
