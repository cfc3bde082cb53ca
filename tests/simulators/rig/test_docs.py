"""docs/simulators.md lists every key of a simulated camera with its default."""

import re

from simulators.rig.camera_settings import CameraSettings
from tests.places import DOCS

SECTION = (DOCS / "simulators.md").read_text(encoding="utf-8").split("\n## Cameras\n")[1].split("\n## ")[0]


def test_every_key_of_a_simulated_camera_is_listed_with_its_default() -> None:
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \| ([^|]+) \|", SECTION, re.MULTILINE)
    listed = {key: default.strip() for keys, default in rows for key in re.findall(r"`(\w+)`", keys)}
    defaults = CameraSettings().model_dump()
    assert listed.keys() == defaults.keys()
    assert listed == {key: _shown(value) for key, value in defaults.items()}


def _shown(value: object) -> str:
    return "none" if value is None else str(value)
