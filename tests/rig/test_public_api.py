"""Tests of the public names of the package `rig`; `tests/test_public_api.py` tests all packages."""

import re

from tests.places import DOCS, EXAMPLES


def test_the_example_of_the_documentation_runs(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / "protocols.md").read_text(), re.S)
    small = 'driver = "simulated-camera"\nwidth_px = 32\nheight_px = 24'
    (tmp_path / "examples").mkdir()
    for path in EXAMPLES.glob("*.toml"):
        text = path.read_text().replace('driver = "simulated-camera"', small)
        (tmp_path / "examples" / path.name).write_text(text)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "docs/protocols.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    # the grid, the reference, two still images and 16 turns by 22.5 deg, seen by two cameras
    assert printed[0] == "20 steps, 40 images"
    assert printed[1:4] == ["step 0 (grid)", "step 1 (reference)", "step 2 (static after 5 s)"]
    assert printed[20] == "step 19 (rotation 360 deg)"
    assert printed[21] == "completed"
    assert printed[-1].split()[:2] == ["rotation", "360.0"]
