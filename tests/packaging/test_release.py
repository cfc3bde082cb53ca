"""The conda recipe, the container file and the checks of commits follow pyproject.toml and the checkout."""

import os
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RECIPE = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
CONTAINER = (ROOT / "Containerfile").read_text(encoding="utf-8")
# The names of packages that conda-forge has under another name
CONDA_NAMES = {"opencv-python-headless": "py-opencv", "matplotlib": "matplotlib-base"}


def of_checkout(name: str) -> Path:
    """Return the path of a file that a source distribution does not have."""
    if not (ROOT / name).exists():
        pytest.skip(f"needs a checkout: {name}")
    return ROOT / name


def read_yaml(name: str) -> Any:
    return yaml.safe_load(of_checkout(name).read_text(encoding="utf-8"))


def as_conda(requirement: str) -> str:
    """Return a requirement of pyproject.toml in the words of conda."""
    name, bounds = re.fullmatch(r"([\w-]+)(.*)", requirement).groups()
    return f"{CONDA_NAMES.get(name, name)} {bounds}".strip()


def test_conda_package_needs_what_the_project_needs():
    project = PROJECT["project"]
    assert RECIPE["requirements"]["run"] == [
        "python >=${{ python_min }}",
        *map(as_conda, project["dependencies"]),
    ]
    assert f">={RECIPE['context']['python_min']}" == project["requires-python"]
    assert set(map(as_conda, PROJECT["build-system"]["requires"])) < set(RECIPE["requirements"]["host"])


def test_conda_package_has_the_commands_and_the_licence_of_the_project():
    project = PROJECT["project"]
    commands = [f"{name} = {place}" for name, place in project["scripts"].items()]
    assert RECIPE["build"]["python"]["entry_points"] == commands
    assert RECIPE["about"]["license"] == project["license"]
    assert RECIPE["about"]["license_file"] == project["license-files"]


def test_container_has_a_locked_python_that_the_project_names():
    (version,) = set(re.findall(r"^FROM python:(\S+)-slim", CONTAINER, re.MULTILINE))
    assert f"Programming Language :: Python :: {version}" in PROJECT["project"]["classifiers"]
    assert re.findall(r"/src/(constraints/\S+)", CONTAINER) == [f"constraints/python-{version}.txt"]
    assert (ROOT / "constraints" / f"python-{version}.txt").is_file()


def test_container_is_built_from_all_that_the_wheel_is_built_from():
    sent = re.findall(r"^!(.*)$", of_checkout(".dockerignore").read_text(encoding="utf-8"), re.MULTILINE)
    packages = [name.rstrip("*") for name in PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]]
    project = PROJECT["project"]
    described = {"pyproject.toml", project["readme"], *project["license-files"]}
    assert set(sent) == {"constraints", "examples", *described, *packages}


def test_hosted_ci_runs_what_ci_runs():
    (job,) = read_yaml(".github/workflows/ci.yml")["jobs"].values()
    assert job["steps"][-1]["run"].splitlines()[-1] == ".ci/run"
    assert os.access(of_checkout(".ci/run"), os.X_OK)


def test_every_hook_before_a_commit_can_be_run():
    tools = of_checkout(".venv/bin")
    (local,) = read_yaml(".pre-commit-config.yaml")["repos"]
    assert local["repo"] == "local"
    for hook in local["hooks"]:
        command, *arguments = shlex.split(hook["entry"])
        assert Path(command).parent == Path(".venv/bin"), hook
        assert (tools / Path(command).name).exists(), hook
        assert [name for name in arguments if name.endswith(".py") and not (ROOT / name).exists()] == []
