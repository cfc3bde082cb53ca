"""A virtual rig beside a closed machine, for tests of commands; its camera is small, and it starts soon."""

from pathlib import Path

RIG = """
[rig]
name = "beside a closed machine"
[simulation]
driver = "virtual-rig"
[simulation.closed_machine]
start_s = 2.0
program = [{ to_mm = 1.0, speed_mm_s = 0.05 }, { wait_s = 100.0 }]
force = { full_scale = 50000.0, delay_s = 0.1, jitter_s = 0.02, noise_v = 0.001 }
[cameras.front]
driver = "simulated-camera"
width_px = 64
height_px = 48
focal_px = 210.0
[channels.box]
driver = "modbus-channels"
address = "@closed_machine"
rate_hz = 50
[channels.box.signals.force]
input = 0
type = "f32"
unit = "N"
scale = 5000.0
range = [-50000, 50000]
delay_s = 0.1
delay_std_s = 0.006
[load_frame]
load = "channels.force"
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
PROTOCOL = """
kind = "acquire"
title = "beside the old machine"
grid_images = "never"
reference = false
[acquire]
every_s = 0.5
[end]
duration_s = 10
"""


def write_rig(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the rig file with changes of its text, each of which must apply."""
    text = RIG
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def write_protocol(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the protocol file with changes of its text, each of which must apply."""
    text = PROTOCOL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "beside.toml"
    path.write_text(text)
    return path
