"""All places that state the version agree with pyproject.toml."""

import re
import tomllib
from importlib.metadata import version

import pytest
from click.testing import CliRunner

import dic
import dic.cli
import rig.cli
from tests.places import ROOT

VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]


def test_installed_package_says_it():
    assert version("offaxis") == VERSION, "installed before the version changed: run make install"


def test_package_says_it():
    assert dic.__version__ == VERSION


@pytest.mark.parametrize("command", [dic.cli.dic, rig.cli.cli], ids=["dic", "rig"])
def test_commands_say_it(command):
    assert CliRunner().invoke(command, ["--version"]).output.split()[-1] == VERSION


def test_citation_says_it():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, re.MULTILINE) == [VERSION]


def test_newest_entry_of_the_changelog_is_about_it():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## \[(.*?)\]", changelog, re.MULTILINE)[0] == VERSION


def test_conda_recipe_says_it():
    recipe = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert re.findall(r"^context:\n  version: (.*)$", recipe, re.MULTILINE) == [VERSION]
