"""Settings for the images of each step, and the limits for the checks of every image."""

from typing import Literal

from pydantic import Field

from drivers.settings import Settings


class Images(Settings):
    """The images that each camera takes per step, and the checks of each image.

    With the default limits only gross failures are reported, such as a failed lamp or a lens out of focus.
    The light, the sharpness and the blur of an image are compared with the image of the reference step.
    """

    per_step: int = Field(default=1, ge=1, le=1000)
    still: int = Field(
        default=2, ge=0, le=100, description="number of still images of the specimen before the test"
    )
    still_every_s: float = Field(default=5.0, gt=0.0, le=3600.0, description="time between the still images")
    timeout_s: float = Field(default=5.0, gt=0.0, le=60.0)
    attempts: int = Field(
        default=3, ge=1, le=20, description="largest number of images taken until one passes"
    )
    on_bad_image: Literal["stop", "keep"] = Field(
        default="keep", description="what happens if no image of a camera passes its checks"
    )
    saturated_max: float = Field(
        default=0.05, ge=0.0, le=1.0, description="largest fraction of saturated pixels"
    )
    light_change_max: float = Field(
        default=0.3, gt=0.0, le=100.0, description="largest change of the mean grey level, as a fraction"
    )
    sharpness_min: float = Field(
        default=0.6, ge=0.0, le=1.0, description="smallest fraction of the reference image's sharpness"
    )
    blur_ratio_max: float = Field(
        default=1.5,
        gt=1.0,
        le=100.0,
        description="largest change of the ratio of sharpness in x to sharpness in y",
    )
    skew_max_s: float = Field(
        default=5.0, gt=0.0, le=3600.0, description="longest time between the images of all cameras"
    )
    camera_return_s: float = Field(
        default=60.0,
        ge=0.0,
        le=3600.0,
        description="longest wait for a camera that failed to deliver images again",
    )
