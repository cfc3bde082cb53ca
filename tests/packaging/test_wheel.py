"""The wheel contains all files of the packages, and works without the checkout."""

import re
import tarfile
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from tests.places import ROOT

pytestmark = pytest.mark.extended

PACKAGES = ("dic/", "drivers/", "rig/", "simulators/")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

READ_MAPS = """
from drivers.load_frames.modbus.registers.map import load_map, shipped_maps
for name in shipped_maps():
    load_map(name)
    print(name)
"""

THEIR_TESTS = """
import socket


def test_a_load_frame_that_can_be_reached(virtual_rig):
    host, port = virtual_rig.addresses["load_frame"].split(":")
    socket.create_connection((host, int(port)), 10.0).close()
"""


@pytest.fixture(scope="module")
def contents(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_source_distribution_is_the_checkout(sdist, tracked):
    with tarfile.open(sdist) as archive:
        held = {name.partition("/")[2] for name in archive.getnames() if archive.getmember(name).isfile()}
    # What only git and continuous integration need stays behind.
    assert {path for path in tracked if not path.startswith(".")} - held == set()
    own = {"PKG-INFO", "setup.cfg"}
    assert {name for name in held - set(tracked) - own if not name.startswith("offaxis.egg-info/")} == set()


def test_wheel_holds_every_tracked_file_of_the_packages_and_no_other(contents, tracked):
    info = f"offaxis-{PROJECT['version']}.dist-info/"
    data = f"offaxis-{PROJECT['version']}.data/data/share/offaxis/"
    code = {name for name in contents if not name.startswith((info, data))}
    assert code == {path for path in tracked if path.startswith(PACKAGES)}
    examples = {name.removeprefix(data) for name in contents if name.startswith(data)}
    assert examples == {path for path in tracked if re.fullmatch(r"examples/[^/]+\.toml", path)}


def test_wheel_holds_the_bytes_of_the_tree(contents):
    changed = [
        name for name, content in contents.items()
        if name.startswith(PACKAGES) and content != (ROOT / name).read_bytes()
    ]  # fmt: skip
    assert not changed


def test_metadata_says_licence_version_and_what_it_is(contents, wheel):
    info = f"offaxis-{PROJECT['version']}.dist-info/"
    metadata = Parser().parsestr(contents[info + "METADATA"].decode())
    assert metadata["License-Expression"] == "BSD-3-Clause AND MIT"
    assert metadata.get_all("License-File") == ["LICENSE", "NOTICE"]
    for name in ("LICENSE", "NOTICE"):
        assert contents[info + f"licenses/{name}"] == (ROOT / name).read_bytes()
    assert metadata["Version"] == PROJECT["version"]
    assert metadata["Summary"] == PROJECT["description"]
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert wheel.name.endswith("-py3-none-any.whl")


def test_code_comes_from_the_wheel(installed, tmp_path):
    where = (
        "import dic, drivers, rig, simulators; print(*(p.__file__ for p in (dic, drivers, rig, simulators)))"
    )
    paths = installed.run("python", "-W", "error", "-c", where, cwd=tmp_path).split()
    assert all(Path(path).is_relative_to(installed.folder) for path in paths)


def test_both_commands_say_the_version(installed, tmp_path):
    for command in ("dic", "rig"):
        assert PROJECT["version"] in installed.run(command, "--version", cwd=tmp_path)


@pytest.mark.long
def test_an_example_is_planned_run_and_verified(installed, tmp_path):
    examples = installed.folder / "share" / "offaxis" / "examples"
    # Its grid, its reference and one step: the whole turn is for the demo.
    protocol = (examples / "rotation.toml").read_text().replace("total_deg = 360.0", "total_deg = 22.5")
    (tmp_path / "rotation.toml").write_text(protocol)
    rig_file = str(examples / "rig-virtual-rotation-30.toml")
    planned = installed.run("rig", "plan", "rotation.toml", "--rig", rig_file, cwd=tmp_path)
    assert "22.5" in planned
    installed.run("rig", "run", "rotation.toml", "--rig", rig_file, "-o", "run.h5", cwd=tmp_path)
    verified = installed.run("rig", "verify", "run.h5", cwd=tmp_path)
    assert "run.h5: completed, 3 of 3 planned steps" in verified


def test_register_maps_are_found(installed, tmp_path):
    reached = installed.run("python", "-c", READ_MAPS, cwd=tmp_path)
    assert reached.split() == ["generic", "scaled-integers", "separate-words"]


def test_pytest_plugin_serves_other_projects(installed, tmp_path):
    (tmp_path / "test_theirs.py").write_text(THEIR_TESTS)
    printed = installed.run("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=tmp_path)
    assert "1 passed" in printed


@pytest.mark.long
def test_the_whole_demonstration_and_the_assessment_run(installed, tmp_path):
    installed.run("rig", "demo", "-o", "demo", cwd=tmp_path)
    assert (tmp_path / "demo" / "report.html").stat().st_size > 100_000
    installed.run("dic", "assess", "-o", "assessment", cwd=tmp_path)
    figures = {path.name for path in (tmp_path / "assessment").glob("figure_*.png")}
    assert figures == {f"figure_{number:02d}.png" for number in range(2, 15)}
