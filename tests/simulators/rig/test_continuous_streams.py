"""The cameras of a virtual rig film a specimen that is pulled all the time, with faults in their pictures."""

import json
from contextlib import ExitStack, closing

import h5py
import numpy as np
import pytest

from dic import Correlator
from drivers.errors import DeviceFault
from drivers.interfaces import OpenContext
from drivers.streams.losses import LossKind
from rig.devices import open_rig
from rig.rigfile import read_rig
from rig.run import run_protocol
from simulators.rig.camera import SPEC
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.planned_faults import FaultPlan
from simulators.rig.truth_log import TruthLog
from simulators.rig.virtual_rig import VirtualRig, VirtualRigSettings
from tests.cost import processor_s
from tests.mistakes import mistakes_of
from tests.places import EXAMPLES

SIDE = 256
CAMERA = {"width_px": SIDE, "height_px": SIDE, "fps": 10.0}
CAMERAS = {"on_axis": CAMERA, "off_axis": CAMERA | {"tilt_deg": 30.0, "shift_us": 2000.0}}
SETTINGS = {"seed": 2, "prepared": {"margin_px": 64}}
SPEED_MM_S = 0.5
DEADLINE_S = 10.0


class Filmed:
    """The frames of both cameras, with their true exposures, while the load frame pulls."""

    def __init__(self, frames=12, cameras=CAMERAS, commands=(), log=None, **settings):
        self.frames = {name: [] for name in cameras}
        self.truth = {name: [] for name in cameras}
        with ExitStack() as stack:
            rig = stack.enter_context(
                closing(VirtualRig(VirtualRigSettings.model_validate(SETTINGS | settings)))
            )
            self.rig = rig
            of_truth = stack.enter_context(closing(TruthLog(log, rig)))
            opened = {
                name: SPEC.open(
                    CameraSettings.model_validate(table), OpenContext(f"cameras.{name}", rig.clock, rig)
                )
                for name, table in cameras.items()
            }
            for command in commands:
                rig.faults.switch_on(command)
            stack.enter_context(rig.clock.activity())
            rig.load_frame.go_to_displacement(5.0, SPEED_MM_S)
            streams = {name: stack.enter_context(camera.stream()) for name, camera in opened.items()}
            for _ in range(frames):
                for name, stream in streams.items():
                    self.frames[name].append(stream.next(DEADLINE_S))
                    self.truth[name].append(opened[name].exposure)
                    of_truth.frame(name, opened[name], self.frames[name][-1])
            self.losses = {name: stream.report().losses for name, stream in streams.items()}

    def first(self, fault, camera):
        """Return the number of the first frame that shows a fault."""
        (found,) = [
            each
            for each in self.rig.picture_faults.first
            if (each.fault, each.taken.camera) == (fault, camera)
        ]
        return found


def test_a_stream_in_simulated_time_shows_the_true_strain_and_repeats_bit_by_bit():
    filmed = Filmed()
    first, last = (filmed.truth["on_axis"][k] for k in (0, -1))
    correlator = Correlator(filmed.frames["on_axis"][0].image)
    field = correlator.correlate(filmed.frames["on_axis"][-1].image)
    good = field.converged
    stretch = last.surface.deformation_gradient[1, 1] / first.surface.deformation_gradient[1, 1]
    assert stretch - 1.0 > 1e-4
    # the y axis of the image points down; the strain of the whole field from the displacements
    slope = np.polyfit(field.points[good.ravel()][:, 1], field.v_px[good], 1)[0]
    assert slope == pytest.approx(stretch - 1.0, abs=2e-5)
    again = Filmed()
    for name, frames in filmed.frames.items():
        for ours, theirs in zip(frames, again.frames[name], strict=True):
            assert (ours.sequence, ours.middle_s, ours.received_s) == (
                theirs.sequence,
                theirs.middle_s,
                theirs.received_s,
            )
            np.testing.assert_array_equal(ours.image, theirs.image)


def test_starts_roll_and_are_late_and_the_stamp_knows_it_or_not():
    late = {"fast_ppm": 500.0, "delay_us": 3000.0, "jitter_us": 4000.0}
    cameras = {
        "knows": CAMERA | late,
        "does_not": CAMERA | late | {"stamp": "meant", "stamp_std_us": 1500.0},
    }
    filmed = Filmed(frames=40, cameras=cameras, prepared=None)
    for name, frames in filmed.frames.items():
        late_s = []
        for frame, true in zip(frames, filmed.truth[name], strict=True):
            meant_s = frame.sequence * 0.1 * (1 - 500e-6)
            late_s.append(true.taken.begins_s - meant_s)
            assert true.middle_s == pytest.approx(true.taken.begins_s + 0.005)
            unknown_s = 0.0 if name == "knows" else late_s[-1]
            assert frame.exposed_s == pytest.approx(true.taken.begins_s - unknown_s)
            assert frame.middle_s == pytest.approx(true.middle_s - unknown_s)
            assert frame.middle_std_s == pytest.approx(0.0 if name == "knows" else 1.5e-3)
        assert 0.003 <= min(late_s) < 0.0035
        assert 0.0065 < max(late_s) <= 0.007
    assert mistakes_of(CameraSettings, CAMERA | {"jitter_us": 95_000.0})
    assert mistakes_of(CameraSettings, {"fast_ppm": 10.0})


@pytest.mark.parametrize(
    "fault", ["glare:400", "cover", "cover:0.5", "tear:800", "flicker:50", "creep:500", "roll:9000"]
)
def test_a_fault_begins_at_its_time_and_with_one_camera(fault):
    name = fault.partition(":")[0]
    short = {key: table | {"exposure_us": 4000.0} for key, table in CAMERAS.items()}
    plan = {"fault": f"picture.{fault}@off_axis", "after_s": 0.5037}
    sound, faulty = Filmed(cameras=short), Filmed(cameras=short, faults=[plan])
    assert [each.fault for each in faulty.rig.picture_faults.first] == [name]
    first = faulty.first(name, "off_axis")
    assert first.since_s == pytest.approx(0.5037)
    # frame 5 is exposed from 0.502 to 0.506 s
    assert first.taken.sequence == 5
    for camera, frames in faulty.frames.items():
        for number, (ours, theirs) in enumerate(zip(frames, sound.frames[camera], strict=True)):
            off = np.abs(ours.image.astype(float) - theirs.image).max()
            same = camera == "on_axis" or number < first.taken.sequence
            assert (off == 0.0) if same else (off > 4.0 or number == 5), (camera, number)
            assert faulty.truth[camera][number].faults == (() if same else (name,))
    last = faulty.frames["off_axis"][-1].image
    match name:
        case "glare":
            # the radius is 20 px and 400 px for each of the 0.6 s
            assert (last == 255).mean() > 0.5
        case "cover":
            assert last.mean() < 6
        case "tear":
            assert (last < 12).any(axis=1).sum() > 15


def test_a_lamp_flickers_by_what_its_oscillation_leaves_over_the_exposure():
    for exposure_us, seen in ((10_000.0, False), (2000.0, True)):
        # 9.7 Hz beats against 100 Hz
        cameras = {"one": CAMERA | {"fps": 9.7, "exposure_us": exposure_us}}
        filmed = Filmed(frames=10, cameras=cameras, commands=["picture.flicker:50"], prepared=None)
        means = np.array([frame.image.mean() for frame in filmed.frames["one"]])
        assert (np.ptp(means) / means.mean() > 0.5) == seen


def test_a_fault_begins_in_a_state_and_the_log_says_with_which_exposure(tmp_path):
    plan = {"fault": "picture.cover@on_axis", "when": "displacement_mm", "above": 0.3}
    filmed = Filmed(log=tmp_path / "truth.jsonl", faults=[plan])
    first = filmed.first("cover", "on_axis")
    shown_mm = [true.surface.displacement_mm for true in filmed.truth["on_axis"]]
    assert shown_mm[first.taken.sequence - 1] < 0.3 < shown_mm[first.taken.sequence] + SPEED_MM_S * 0.02
    lines = [json.loads(line) for line in (tmp_path / "truth.jsonl").read_text().splitlines()]
    (begun,) = [line for line in lines if line["what"] == "fault"]
    (picture,) = [line for line in lines if line["what"] == "picture"]
    assert (begun["fault"], begun["time_s"]) == ("picture.cover@on_axis", first.since_s)
    assert (picture["camera"], picture["sequence"]) == ("on_axis", first.taken.sequence)
    assert picture["time_s"] == first.taken.begins_s
    bad = [line["sequence"] for line in lines if line["what"] == "frame" and line["faults"]]
    assert bad == list(range(first.taken.sequence, 12))


def test_repeated_and_lost_frames_are_noted_too():
    faults = [
        {"fault": "picture.frozen:1@on_axis", "after_s": 0.25},
        {"fault": "camera.drop:1", "after_s": 0.62},
    ]
    filmed = Filmed(faults=faults)
    frames = filmed.frames["on_axis"]
    repeated = filmed.first("frozen", "on_axis").taken.sequence
    np.testing.assert_array_equal(frames[repeated].image, frames[repeated - 1].image)
    (lost,) = [each for each in filmed.rig.picture_faults.first if each.fault == "drop"]
    (gap,) = [loss for loss in filmed.losses[lost.taken.camera] if loss.kind is LossKind.GAP]
    assert (gap.first, gap.count) == (lost.taken.sequence, 1)


def test_mistakes_in_planned_faults_are_told():
    for table, told in [
        ({"fault": "picture.cover"}, "either after_s or when"),
        ({"fault": "picture.cover", "after_s": 1.0, "above": 2.0}, "above or below is expected with when"),
        ({"fault": "picture.covered", "after_s": 1.0}, "expected one of"),
    ]:
        (mistake,) = mistakes_of(FaultPlan, table)
        assert told in mistake
    with pytest.raises(DeviceFault, match=r"expected one of off_axis, on_axis after @, got 'side'"):
        Filmed(faults=[{"fault": "picture.cover@side", "after_s": 0.1}])


RIG = """
[rig]
name = "beside a closed machine"

[simulation]
driver = "virtual-rig"
prepared = { margin_px = 64 }
faults = [{ fault = "picture.cover@side", after_s = 20.25 }]

[simulation.closed_machine]
start_s = 5.0
program = [{ to_mm = 2.0, speed_mm_s = 0.05 }]

[cameras.front]
driver = "simulated-camera"
width_px = 128
height_px = 128
fps = 10.0

[cameras.side]
driver = "simulated-camera"
width_px = 128
height_px = 128
tilt_deg = 30.0
fps = 10.0
shift_us = 20000.0

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

[load_frame]
load = "channels.force"

[operator]
driver = "simulated-operator"
duration_s = 1.0
"""
PROTOCOL = """
kind = "acquire"
title = "two cameras at 10 Hz"
grid_images = "never"
reference = false

[acquire]
every_s = 0.1

[end]
duration_s = 22
"""


def test_an_acquisition_in_simulated_time_records_every_frame_of_prepared_cameras(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "protocol.toml").write_text(PROTOCOL)
    outcome = run_protocol(tmp_path / "protocol.toml", tmp_path / "rig.toml", tmp_path / "run.h5")
    assert outcome.is_good, outcome.reason
    assert (outcome.timing.missing, outcome.timing.late) == (0, 0)
    with h5py.File(tmp_path / "run.h5") as file:
        for name in ("front", "side"):
            camera = file[f"entry/instrument/{name}"]
            assert np.diff(camera["sequence"][()]).tolist() == [1] * (len(camera["sequence"]) - 1)
            dark = np.array([image.mean() < 8 for image in camera["data"]])
            covered = camera["exposed_s"][()] + 0.01 > 20.25
            # the first covered picture is exposed to the light for a part of its time only
            assert dark.sum() >= 10 if name == "side" else not dark.any()
            if name == "side":
                assert abs(int(dark.sum()) - int(covered.sum())) <= 1
                assert not (dark & ~covered).any()


@pytest.mark.extended
@pytest.mark.realtime
def test_the_example_films_two_cameras_of_2048_px_in_real_time(tmp_path):
    text = (EXAMPLES / "rig-virtual-continuous.toml").read_text(encoding="utf-8")
    text = text.replace('driver = "virtual-rig"', 'driver = "virtual-rig"\nreal_time = true')
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    seconds = 6.0
    with open_rig(read_rig(tmp_path / "rig.toml")) as rig, ExitStack() as stack:
        streams = [stack.enter_context(closing(each.stream(64))) for each in rig.cameras.values()]
        rig.load_frame.go_to_displacement(1.0, 0.05)
        begun_s, used_s, late_s = rig.clock.now_s(), processor_s(), []
        while rig.clock.now_s() - begun_s < seconds:
            late_s += [
                frame.received_s - frame.middle_s - 0.025 for frame in (each.next(5.0) for each in streams)
            ]
        used = (processor_s() - used_s) / (rig.clock.now_s() - begun_s)
        lost = [each.report().lost for each in streams]
        rig.load_frame.hold()
    print(
        f"two cameras of 2048 x 2048 px at 10 frames/s: {used:.2f} of a processor, {lost} lost, "
        f"frames late by {1e3 * np.median(late_s):.1f} ms in the median, {1e3 * max(late_s):.1f} ms at most"
    )
    assert lost == [0, 0]
    assert used < 0.5
