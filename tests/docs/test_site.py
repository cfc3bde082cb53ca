"""The documentation site is built without warnings, such as for a dead link or an unlinked page.

Continuous integration builds the site by `make docs`, beside the quick tests.
"""

import subprocess
import sys
from importlib import import_module
from inspect import isclass, ismodule, isroutine

import pytest

from tests.places import DOCS

pytest.importorskip("sphinx", reason="needs the group docs: pip install offaxis[docs]")
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    build = ["-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", str(folder / "doctrees")]
    done = subprocess.run(
        [sys.executable, *build, str(DOCS), str(folder / "html")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def test_reference_knows_every_command(site):
    page = (site / "reference" / "command-line.html").read_text(encoding="utf-8")
    for command in ("dic-calibrate", "dic-correlate", "dic-process", "rig-plan", "rig-run", "rig-simulate"):
        assert f'id="{command}"' in page


def test_notebooks_are_pages_with_their_code(site):
    page = (site / "notebooks" / "images-to-strain.html").read_text(encoding="utf-8")
    assert "measure_images" in page


@pytest.mark.parametrize("package", ["dic", "drivers", "rig", "simulators"])
def test_reference_describes_all_that_is_public(site, package):
    page = (site / "reference" / f"{package}.html").read_text(encoding="utf-8")
    modules = [import_module(package)]
    modules += [value for name in modules[0].__all__ if ismodule(value := getattr(modules[0], name))]
    # What is neither a class nor a function, such as the version or the name of a type, needs no description.
    values = {name: getattr(module, name) for module in modules for name in module.__all__}
    described = [name for name, value in values.items() if isclass(value) or isroutine(value)]
    assert len(described) > 20
    sign = '<span class="sig-name descname"><span class="pre">{}<'
    assert [name for name in described if sign.format(name) not in page] == []
