"""Beside a closed machine: the cameras see the specimen that it pulls, and channels read its outputs."""

import json
import math
from contextlib import ExitStack, closing

import numpy as np
import pytest

from drivers.channels.modbus import SPEC as CHANNELS, ModbusChannelsSettings
from drivers.clock import VirtualClock
from drivers.errors import ConfigurationError, LinkLost
from drivers.interfaces import OpenContext
from drivers.triggers.modbus import SPEC as TRIGGER
from simulators.rig.camera import SPEC as CAMERA
from simulators.rig.simulation import Simulation
from simulators.rig.truth_log import TruthLog
from simulators.rig.virtual_rig import VirtualRig, VirtualRigSettings
from tests.simulators.small_rig import SMALL

DELAY_S, JITTER_S, NOISE_V = 0.15, 0.02, 0.001
FORCE = {"input": 0, "type": "f32", "unit": "N", "scale": 5000.0, "range": [-50e3, 50e3], "invalid": [-9999]}
PROGRAM = {
    "start_s": 5.0,
    "program": [{"to_mm": 1.5, "speed_mm_s": 0.05}, {"wait_s": 5.0}, {"to_mm": 1.0, "speed_mm_s": 0.05}],
    "force": {"full_scale": 50e3, "delay_s": DELAY_S, "jitter_s": JITTER_S, "noise_v": NOISE_V},
}


@pytest.fixture
def rig():
    with closing(VirtualRig(VirtualRigSettings.model_validate({"closed_machine": PROGRAM}))) as rig:
        yield rig


@pytest.fixture
def opened(rig):
    with ExitStack() as stack:

        def open_one(spec, name, **settings):
            context = OpenContext(name, rig.clock, rig, patience_s=rig.patience_s)
            return stack.enter_context(closing(spec.open(spec.settings.model_validate(settings), context)))

        yield open_one


def channels(opened, **table):
    given = {"address": "@closed_machine", "rate_hz": 100.0, "signals": {"force": FORCE}}
    return opened(CHANNELS, "channels.box", **given | table)


def test_the_camera_sees_the_specimen_that_the_machine_pulls(rig, opened):
    camera = opened(CAMERA, "cameras.front", **{key: SMALL[key] for key in SMALL if key != "driver"})
    for at_s in (2.0, 20.0, 37.0, 42.0, 60.0):
        rig.clock.sleep(at_s - rig.clock.now_s())
        frame = camera.grab(1.0)
        true = rig.closed_machine.state_at(frame.exposed_s + 0.5e-6 * frame.exposure_us)
        assert camera.shown.load_n == true.load_n
        assert camera.shown.deformation_gradient.tolist() == true.deformation_gradient().tolist()
    assert camera.shown.load_n > 0.0
    assert camera.shown.displacement_mm == 1.0


def test_the_load_at_an_image_is_in_the_record_of_the_channel(rig, opened):
    device = channels(opened)
    samples = [device.read(1.0) for _ in range(3000)]
    times_s = np.array([each.asked_s for each in samples]) - DELAY_S
    loads_n = np.array([each.values[0, 0] for each in samples])
    middles_s = np.linspace(6.0, 28.0, 500)
    true_n = np.array([rig.closed_machine.state_at(middle_s).load_n for middle_s in middles_s])
    error_n = np.interp(middles_s, times_s, loads_n) - true_n
    # the fastest rise of the load, the jitter of the delay, and the noise
    rate_n_s = np.abs(np.gradient(true_n, middles_s)).max()
    stated_n = math.hypot(rate_n_s * JITTER_S / math.sqrt(12.0), 5000.0 * NOISE_V)
    assert rate_n_s > 300.0
    assert np.sqrt(np.mean(error_n**2)) < stated_n
    assert abs(np.mean(error_n)) < 0.2 * stated_n
    # without the declared delay, the load would be wrong by far more
    shifted_n = np.interp(middles_s, times_s + DELAY_S, loads_n) - true_n
    assert np.sqrt(np.mean(shifted_n**2)) > 5.0 * stated_n


def test_an_overflow_is_beyond_the_range_and_a_broken_sensor_is_no_number(rig, opened):
    device = channels(opened)
    rig.faults.switch_on("closed_machine.overflow")
    assert device.read(1.0).values[0, 0] > device.signals[0].high
    rig.faults.clear()
    rig.faults.switch_on("closed_machine.broken-sensor")
    assert np.isnan(device.read(1.0).values[0, 0])


def test_the_truth_is_that_of_the_machine_and_of_its_outputs(rig, opened, tmp_path):
    path = tmp_path / "truth.jsonl"
    with closing(TruthLog(path, rig)) as log:
        camera = opened(CAMERA, "cameras.front", **{key: SMALL[key] for key in SMALL if key != "driver"})
        trigger = opened(TRIGGER, "triggers.logger", address="@closed_machine", output=2, width_s=0.05)
        rig.clock.sleep(20.0)
        log.sample()
        trigger.pulse()
        log.frame("front", camera, camera.grab(1.0))
        rig.clock.sleep(1.0)
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    (first, *_, last) = [line for line in lines if line["what"] == "sample"]
    true = rig.closed_machine.state_at(first["time_s"])
    assert (first["load_n"], first["axial_strain"]) == (true.load_n, true.axial_strain)
    assert first["displacement_mm"] == pytest.approx(0.05 * 15.0, rel=1e-6)
    assert (first["program_running"], first["trigger_pulses"]) == (True, 16)
    assert last["load_n"] > first["load_n"]
    switched = [line for line in lines if line["what"] == "command"]
    assert [(line["device"], line["command"]) for line in switched] == [
        ("closed_machine", "output 2 on"),
        ("closed_machine", "output 2 off"),
    ]
    assert switched[1]["time_s"] - switched[0]["time_s"] == pytest.approx(0.05)
    (frame,) = [line for line in lines if line["what"] == "frame"]
    middle_s = frame["time_s"] + 0.5e-6 * SMALL["exposure_us"]
    assert frame["load_n"] == rig.closed_machine.state_at(middle_s).load_n


def test_no_program_reaches_the_load_frame(rig):
    assert "closed_machine" in rig.addresses
    assert not any(name.startswith("load_frame") for name in rig.addresses)
    settings = ModbusChannelsSettings.model_validate(
        {"address": "@closed_machine", "rate_hz": 1.0, "signals": {"force": FORCE}}
    )
    with closing(VirtualRig()) as usual, pytest.raises(LinkLost, match="a server 'closed_machine'"):
        CHANNELS.open(settings, OpenContext("channels.box", VirtualClock(), usual))


def test_a_rig_file_for_other_programs_names_the_box():
    tables = {
        "simulation": {"driver": "virtual-rig", "closed_machine": PROGRAM},
        "load_frame": {"load": "channels.force"},
        "channels": {
            "box": {
                "driver": "modbus-channels",
                "address": "@closed_machine",
                "rate_hz": 50,
                "signals": {"force": FORCE},
            }
        },
        "triggers": {"logger": {"driver": "modbus-pulse", "address": "@closed_machine", "output": 0}},
    }
    with closing(Simulation(tables)) as simulation:
        text = simulation.rig_file()
        address = simulation.addresses["closed_machine"]
    for part in ('[load_frame]\nload = "channels.force"', "[channels.box]", "[triggers.logger]"):
        assert part in text
    assert text.count(f'address = "{address}"') == 2
    assert 'signals = {force = {input = 0, type = "f32"' in text


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (
            {"channels": {"box": {"driver": "modbus-channels", "address": "10.0.0.1:502"}}},
            "channels.box: the",
        ),
        ({"channels": {"box": {"address": "@load_frame"}}}, "is none of the simulation's servers"),
        ({"channels": 3}, "tables [channels.NAME] are expected"),
        ({"load_frame": {"driver": "modbus-frame", "address": "@load_frame"}}, "is none of"),
    ],
)
def test_addresses_that_the_simulation_does_not_have_are_refused(tables, said):
    simulation = {"simulation": {"driver": "virtual-rig", "closed_machine": PROGRAM}}
    with pytest.raises(ConfigurationError) as raised:
        Simulation(simulation | tables)
    assert said in str(raised.value)
