"""The drivers accept the parts of rig files that docs/cameras.md shows."""

import re
import tomllib

import pytest

from drivers.registry import find_driver
from tests.places import DOCS

DOCUMENT = DOCS / "cameras.md"
(EXAMPLE,) = re.findall(r"```toml\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
CAMERAS = tomllib.loads(EXAMPLE)["cameras"]


@pytest.mark.parametrize("name", CAMERAS)
def test_an_example_of_the_documentation_is_valid(name: str) -> None:
    values = dict(CAMERAS[name])
    spec = find_driver(values.pop("driver"))
    settings = spec.settings.model_validate(values)
    assert spec.kind == "camera"
    # a plan tells from these how large a run will be
    assert getattr(settings, "bits", None) in (8, 12)
    assert set(values) <= set(spec.settings.model_fields)


def test_every_camera_driver_stands_in_the_documentation() -> None:
    assert {camera["driver"] for camera in CAMERAS.values()} == {
        "v4l2",
        "aravis",
        "gentl",
        "opencv-camera",
    }
