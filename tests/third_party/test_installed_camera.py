"""A third party's camera in a separate package is found, checked, used, and passes the contract tests."""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from drivers.settings import toml_table
from tests.places import EXAMPLES, example

pytestmark = pytest.mark.extended

PACKAGE = Path(__file__).parent / "swan_camera"
OFFLINE = ("--no-index", "--no-deps", "--no-build-isolation", "--disable-pip-version-check", "--quiet")
RIG = (sys.executable, "-c", "from rig.cli import main; main()")
CAMERA = {"driver": "swan", "serial": "S-0042"}


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder in which the third party's package is installed."""
    source, folder = tmp_path_factory.mktemp("source") / "swan", tmp_path_factory.mktemp("packages")
    shutil.copytree(PACKAGE, source)
    command = [sys.executable, "-m", "pip", "install", *OFFLINE, "--target", str(folder), str(source)]
    subprocess.run(command, check=True, timeout=300)
    return folder


@pytest.fixture
def run(installed, tmp_path):
    def call(*command: object) -> str:
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "COV"))}
        done = subprocess.run(
            [str(part) for part in command],
            cwd=tmp_path,
            env=environment | {"PYTHONPATH": str(installed)},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return call


@pytest.fixture
def rig_file(tmp_path) -> Path:
    """The rig file of a virtual rig with the third party's camera as its only camera."""
    text = (EXAMPLES / "rig-virtual-rotation-30.toml").read_text()
    before, stage = text[: text.index("[cameras.")], text[text.index("[stage]") :]
    path = tmp_path / "rig.toml"
    path.write_text("\n".join([before, toml_table(["cameras", "left"], CAMERA), stage]))
    return path


def test_rig_devices_finds_it_and_writes_it_into_the_rig_file(run, tmp_path):
    printed = run(*RIG, "devices", "--no-probe", "-o", "found.toml", "--json", "found.json")
    assert "camera S-0042: Swan Cygnet, serial number S-0042" in printed
    cameras = json.loads((tmp_path / "found.json").read_text())["cameras"]
    told = {"driver": "swan", "place": "S-0042", "name": "Swan Cygnet, serial number S-0042"}
    assert told in cameras
    assert CAMERA in tomllib.loads((tmp_path / "found.toml").read_text())["cameras"].values()


def test_rig_check_judges_its_image(run, rig_file, tmp_path):
    printed = run(*RIG, "check", rig_file, "--json", "check.json")
    assert "cameras.left: vendor Swan, model Cygnet, serial S-0042" in printed
    camera = json.loads((tmp_path / "check.json").read_text())["devices"]["cameras.left"]
    # speckles of standard deviation 1.5 px are 4 √(ln 2) · 1.5 px = 5 px wide
    assert camera["quality"]["speckle_x_px"] == pytest.approx(5.0, rel=0.1)
    assert camera["findings"] == []


def test_rig_run_records_its_images(run, rig_file, tmp_path):
    protocol = example("rotation", ("total_deg = 360.0", "total_deg = 22.5"))
    (tmp_path / "protocol.toml").write_text(protocol)
    run(*RIG, "run", "protocol.toml", "--rig", rig_file, "-o", "run.h5", "--json", "run.json")
    done = json.loads((tmp_path / "run.json").read_text())
    assert done["status"] == "completed"
    assert [step["images"] for step in done["steps"]] == [{"left": 1}] * 3
    assert "left: 3 images, 3 in finished steps, 0 damaged" in run(*RIG, "verify", "run.h5")


def test_it_is_held_to_the_contract(run, tmp_path):
    # outside this checkout, so that its conftest and its settings do not count
    contract = shutil.copy(PACKAGE / "keeps_contract.py", tmp_path)
    assert " passed" in run(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", contract)
