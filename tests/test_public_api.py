"""Tests of the public names of all packages."""

import ast
import doctest
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ("dic", "drivers", "rig", "simulators")
EXAMPLES_NEED_NO_FILES = ("drivers", "simulators")


def imported_for_types(path: Path) -> set[str]:
    """Return the names that a package imports for type checkers only."""
    (block,) = (
        node
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.If) and "not" not in ast.unparse(node.test)
    )
    return {name.name for node in block.body if isinstance(node, ast.ImportFrom) for name in node.names}


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_is_there_for_python_and_for_type_checkers(name):
    package = importlib.import_module(name)
    assert imported_for_types(Path(package.__file__)) == set(package.__all__) - {"__version__"}
    assert set(package.__all__) <= set(dir(package))
    for public in package.__all__:
        assert getattr(package, public) is not None


@pytest.mark.parametrize("name", PACKAGES)
def test_a_name_that_is_not_there_is_an_attribute_error(name):
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        _ = importlib.import_module(name).nothing


@pytest.mark.parametrize("name", PACKAGES)
def test_importing_it_loads_nothing_of_others(name):
    script = f"import sys; before = set(sys.modules); import {name}; print(sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = {module.partition(".")[0] for module in ast.literal_eval(done.stdout)}
    assert loaded <= {name} | set(sys.stdlib_module_names)


@pytest.mark.parametrize("name", EXAMPLES_NEED_NO_FILES)
def test_its_example_prints_what_it_says(name):
    found = doctest.testmod(importlib.import_module(name))
    assert (found.failed, found.attempted > 0) == (0, True)
