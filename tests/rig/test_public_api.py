"""What `import rig` gives to a Python user."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import rig
from tests.places import DOCS, EXAMPLES


def imported_for_types() -> set[str]:
    """The names that type checkers see."""
    tree = ast.parse(Path(rig.__file__).read_text())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {name.name for node in imports for name in node.names} - {"import_module", "TYPE_CHECKING", "Any"}


def test_every_public_name_is_there_for_python_and_for_type_checkers():
    assert imported_for_types() == set(rig.__all__)
    assert set(rig.__all__) <= set(dir(rig))
    for name in rig.__all__:
        assert getattr(rig, name) is not None


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'rig' has no attribute 'nothing'"):
        _ = rig.nothing


def test_importing_it_loads_nothing_of_others():
    script = "import sys; before = set(sys.modules); import rig; print(sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in ast.literal_eval(done.stdout)}
    assert loaded <= {"rig"} | set(sys.stdlib_module_names)


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
    # the grid, the reference and 16 turns by 22.5 deg, seen by two cameras
    assert printed[0] == "18 steps, 36 images"
    assert printed[1:3] == ["step 0 (grid)", "step 1 (reference)"]
    assert printed[18] == "step 17 (rotation 360 deg)"
    assert printed[19] == "completed"
    assert printed[-1].split()[:2] == ["rotation", "360.0"]
