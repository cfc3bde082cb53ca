"""The imports of a simulated rig load no slow packages, because `rig run` would wait for them."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("simulators.rig.scene_client", {"numba", "scipy"}),
        ("simulators.rig.simulation", {"scipy.ndimage"}),
    ],
)
def test_rig_is_loaded_without_what_only_pictures_need(module: str, heavy: set[str]) -> None:
    script = f"import sys, {module}; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
