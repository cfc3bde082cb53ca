"""Every plan and every start of a run warn of dangers that the rig file accepts."""

import tomllib
from dataclasses import replace

import pytest

from rig.guardian.machines import cautions, watched
from rig.protocol.protocol import TensionProtocol
from rig.rigfile import read_rig
from rig.run import plan_protocol
from tests.command_line import run_rig
from tests.places import EXAMPLES, example

REAL = ('address = "@load_frame"', 'address = "10.0.0.8:502"')
OFF = ('map = "generic"', 'map = "generic"\nwatchdog = "off: the drive trips on every pause"')


@pytest.fixture
def rig_path(tmp_path):
    def write(*changes):
        path = tmp_path / "rig.toml"
        path.write_text(example("rig-virtual-tension", *changes))
        return path

    return write


def test_a_rig_without_dangers_has_none(rig_path):
    assert cautions(read_rig(rig_path(REAL))) == []


def test_a_machine_inside_this_program_needs_no_guardian(rig_path):
    assert [entry.name for entry in watched(read_rig(rig_path()))] == []
    assert [entry.name for entry in watched(read_rig(rig_path(REAL)))] == ["load_frame"]


def test_a_driver_that_no_guardian_can_use_is_named(rig_path):
    rig_file = read_rig(rig_path(REAL))
    unguarded = replace(rig_file.load_frame, spec=replace(rig_file.load_frame.spec, guard=None))
    (sentence,) = cautions(replace(rig_file, load_frame=unguarded))
    assert sentence.startswith(
        "load_frame: no guardian can stop it, because its driver 'modbus-frame' does not"
    )


def test_the_plan_and_the_start_say_that_the_watchdog_is_off(rig_path, tmp_path):
    path, said = (
        rig_path(OFF),
        "load_frame: the machine's own watchdog is off (the drive trips on every pause)",
    )
    protocol = EXAMPLES / "tension.toml"
    assert [caution.partition(":")[0] for caution in plan_protocol(protocol, path).cautions] == ["load_frame"]
    planned = run_rig("plan", protocol, "--rig", path, "--json", tmp_path / "plan.json")
    assert f"caution: {said}" in planned.out
    assert planned.report["cautions"][0].startswith(said)
    # the folder for the run file is missing: nothing begins, but the caution came first
    started = run_rig("run", protocol, "--rig", path, "-o", tmp_path / "none" / "run.h5")
    assert started.status == 2
    assert started.err.startswith(f"rig: caution: {said}")


@pytest.mark.parametrize(("increment_n", "good"), [(1000.0, True), (990.0, False)])
def test_a_load_that_is_zeroed_is_at_most_a_tenth_of_an_increment(increment_n, good):
    table = tomllib.loads(example("tension", ("increment_n = 2000.0", f"increment_n = {increment_n}")))
    assert table["loading"]["tare_max_n"] == 100.0
    if good:
        TensionProtocol.model_validate(table)
    else:
        with pytest.raises(ValueError, match=r"tare_max_n must be at most 99 \(10% of loading.increment_n\)"):
            TensionProtocol.model_validate(table)
