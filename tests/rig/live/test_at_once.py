"""Live gauges in simulated time, beside what `dic process` makes of a run file with the same frames."""

from dataclasses import replace

import numpy as np
import pytest

import dic
from drivers.clock import VirtualClock
from drivers.errors import DeviceError
from drivers.interfaces import DeviceInfo
from rig.live.at_once import LiveAtOnce
from rig.live.fields import FieldTask, FieldWork
from rig.live.job import prepared
from rig.live.measuring import Measuring, Shown
from rig.live.opening import open_live
from rig.live.pairing import Arrival
from rig.live.signals import RECORDED, LiveSamples, channels_record
from rig.live.values import GaugeValue, LiveReading
from rig.protocol.live_table import LiveTable
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from simulators.scene.pose import Pose
from tests.rig.live.rendered_rig import GAUGES, INFO, RenderedRig, frame_of
from tests.run_files import HEADER, START

FRAMES, PERIOD_S = 10, 0.25
RAW = ["a=area centre=200,200 size=60,60"]


@pytest.fixture(scope="module")
def rig():
    return RenderedRig(field_every_s=0.7)


@pytest.fixture(scope="module")
def images(rig):
    """Return images of a specimen that straightens while it is stretched."""

    def pose(k):
        part = 1.0 - np.exp(-k / 5.0)
        return Pose.sloped(0.1 * part, -0.15 * part, 0.01 * part)

    return [rig.images(4e-4 * k, pose(k)) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def offline(rig, images, folder):
    """Return the readings of gauges by `dic process`, by the camera's name and the number of the image."""
    job = rig.job
    header = replace(HEADER, grid=job.grid, mounting=job.mounting)
    recorder = Recorder(
        folder / "run.h5", header, rig.infos, load_frame=DeviceInfo("v", "m", "s"),
        channels={RECORDED: channels_record(rig.table)},
    )  # fmt: skip
    pictures = [("grid", rig.grids), ("reference", rig.references), *(("load", each) for each in images)]
    for index, (kind, shown) in enumerate(pictures):
        frames = {
            name: (recorder.frame(name, frame_of(image, index, float(index))), 1)
            for name, image in shown.items()
        }
        step = ProtocolStep(index, kind, 1000.0 if kind == "load" else np.nan)
        recorder.step(StepRecord(step, RigReading(float(index), 1000.0), frames)).result(20)
    values = dict.fromkeys(rig.table.names, GaugeValue(2e-3, 1e-5, True, "", "raw", "aside"))
    readings = [LiveReading(0.1 * k, 0.0, 0.1 * k, {}, values) for k in range(10 * len(pictures))]
    recorder.samples(RECORDED, LiveSamples(rig.table).of(readings))
    recorder.close("completed", "", START)
    dic.process_run(
        folder / "run.h5", rig.table.correlation(), incremental="never", output=folder / "results.h5"
    )
    return {
        name: dic.measure_gauges(folder / "results.h5", rig.table.declared, camera=name).images
        for name in rig.cameras
    }


def live_readings(rig, images):
    """Measure the images in simulated time, and return the readings."""
    clock = VirtualClock()
    live = open_live(
        rig.table, rig.infos, clock, grid=rig.job.grid, mounting=rig.job.mounting,
        thickness_mm=HEADER.sample.thickness_mm,
    )  # fmt: skip
    assert isinstance(live, LiveAtOnce)
    live.prepare(rig.grids, rig.references)
    found = []
    for k, shown in enumerate(images):
        for name, image in shown.items():
            live.offer(name, frame_of(image, k, clock.now_s()))
        found += live.take()
        clock.sleep(PERIOD_S)
    assert (live.failed, live.left_out) == ("", 0)
    live.close()
    return found


def test_live_strain_before_the_correction_equals_that_of_dic_process(rig, images, offline):
    job = replace(rig.job, thickness_mm=HEADER.sample.thickness_mm)
    measuring = Measuring(prepared(job, rig.grids, rig.references), best_only=False)
    for k, shown in enumerate(images):
        frames = {name: Shown(Arrival(k + 1, PERIOD_S * k), image) for name, image in shown.items()}
        measuring.measure(frames, {})
        for name, live in measuring.images.items():
            for gauge in rig.table.names:
                for kind in ("raw", "calibrated"):
                    here = live[gauge].readings[kind].strain
                    assert here == pytest.approx(offline[name][k].readings[gauge][kind].strain, abs=1e-6)


def test_values_do_not_depend_on_what_is_located_ahead_or_left_out(rig, images):
    setups = prepared(rig.job, rig.grids, rig.references)
    at_once, ahead, work = Measuring(setups, best_only=False), Measuring(setups), FieldWork(setups)
    valid = 0
    for k, shown in enumerate(images):
        frames = {name: Shown(Arrival(k + 1, PERIOD_S * k), image) for name, image in shown.items()}
        ahead.locate(*list(frames.items())[k % 2])
        reading = ahead.measure(frames, {})
        assert repr(reading) == repr(at_once.measure(frames, {}))
        valid += all(value.valid for value in reading.gauges.values())
        if k in (1, 3):
            answer = work.done(FieldTask(dict.fromkeys(shown, k + 1), PERIOD_S * k), shown)
            answer.give_to(at_once)
            answer.give_to(ahead)
    assert valid > 2
    assert sorted(len(image.gauges) for image in ahead.images.values()) == [0, 2]


def test_corrected_strain_is_that_of_dic_process_within_its_standard_deviation(rig, images, offline):
    readings = live_readings(rig, images)
    assert len(readings) == FRAMES
    off = []
    for k, reading in enumerate(readings):
        assert reading.time_s == reading.known_s == PERIOD_S * k
        for name, value in reading.gauges.items():
            if value.valid:
                there = offline[value.camera][k].readings[name]["corrected"].strain
                off.append((value.strain - there) / value.std)
            else:
                # Until the first field is there.
                assert (value.cause, k < 4) == ("no_motion", True)
    assert len(off) >= 12
    assert np.mean(np.abs(off) <= 2.0) >= 0.93
    # as text, because NaN differs from itself
    assert repr(live_readings(rig, images)) == repr(readings)


def test_the_live_values_of_a_run_are_known_at_its_images(rig, offline):
    for images in offline.values():
        known = {name: value for name, value in images[3].known.items() if "gauge" in name}
        assert known["channel_gauge.axial"] == pytest.approx(2e-3)
        each = [
            f"channel_gauge.{gauge}{what}" for gauge in ("area", "axial") for what in ("", "_lag", "_std")
        ]
        assert sorted(known) == sorted(each)


def test_an_earlier_run_calibrates_the_cameras_as_its_own_images_do(rig, offline, folder):
    table = LiveTable.model_validate({"gauges": GAUGES, "grid_from": str(folder / "run.h5")})
    job = replace(rig.job, table=table)
    px = np.array([[100.0, 120.0], [300.0, 250.0]])
    own = prepared(rig.job, rig.grids, rig.references)
    earlier = prepared(job, {}, rig.references)
    assert own.pair == earlier.pair == ("aside", "straight")
    for name, setup in earlier.cameras.items():
        np.testing.assert_allclose(
            setup.calibration.map_and_jacobian(px)[0],
            own.cameras[name].calibration.map_and_jacobian(px)[0],
            atol=1e-9,
        )
    with pytest.raises(DeviceError, match=r"expected a camera of .*run\.h5: aside, straight, got other"):
        prepared(job, {}, {"other": rig.references["aside"]})
    narrow = {name: image[:, 20:-20] for name, image in rig.references.items()}
    with pytest.raises(DeviceError, match="images of 360 × 400 px, as the reference, got 400 × 400 px"):
        prepared(job, {}, narrow)


def test_points_that_have_moved_too_far_are_sought_in_the_whole_frame():
    rig, clock = RenderedRig("straight", gauges=RAW, motion="free", search_px=0), VirtualClock()
    live = LiveAtOnce(rig.job, rig.infos, clock)
    live.prepare({}, rig.references)
    causes = []
    for k in range(12):
        moved = rig.cameras["straight"].frame(shift_mm=(0.0, 0.0 if k < 3 else 0.7))
        live.offer("straight", frame_of(moved, k, clock.now_s()))
        causes += [reading.gauges["a"].cause for reading in live.take()]
        clock.sleep(0.1)
    assert causes[:3] == [""] * 3
    assert set(causes[3:8]) == {"low_correlation"}
    # The search has begun at the first bad frame, and its answer is used half a second later.
    assert causes[10:] == [""] * 2


def test_a_missing_camera_is_told_when_the_readings_are_taken():
    rig, clock = RenderedRig(gauges=RAW, motion="free"), VirtualClock()
    live = LiveAtOnce(rig.job, rig.infos, clock)
    live.prepare({}, rig.references)
    for k, shown in enumerate(rig.pulled[:3]):
        for name, image in shown.items():
            live.offer(name, frame_of(image, k, clock.now_s()))
        clock.sleep(0.1)
    assert len(live.take()) == 3
    live.offer("straight", frame_of(rig.pulled[3]["straight"], 3, clock.now_s()))
    assert live.take() == []
    clock.sleep(0.2)
    (reading,) = live.take()
    assert set(reading.frames) == {"straight"}
    assert "no frame for 0.3" in reading.missing["aside"]


def test_a_frame_of_another_format_ends_the_measurement():
    rig, clock = RenderedRig("straight", gauges=RAW, motion="free"), VirtualClock()
    live = LiveAtOnce(rig.job, dict.fromkeys(rig.cameras, INFO), clock)
    live.prepare({}, rig.references)
    live.offer("straight", frame_of(np.zeros((9, 9), np.uint8), 1, 0.0))
    assert live.failed.startswith("live gauges: straight: a frame of another format")


def test_a_value_whose_field_is_declined_says_why():
    rig, clock = RenderedRig("aside", field_every_s=0.2), VirtualClock()
    live = LiveAtOnce(rig.job, rig.infos, clock)
    live.prepare(rig.grids, rig.references)
    told = []
    for k in range(18):
        turned = Pose.turned(np.array([0.0, 0.0, 1.0]), 0.0 if k < 8 else 6.0, np.zeros(3))
        live.offer("aside", frame_of(rig.cameras["aside"].frame(turned), k, clock.now_s()))
        told += [gauge for reading in live.take() for gauge in reading.gauges.values()]
        clock.sleep(0.1)
    declined = [each.reason for each in told if each.cause == "declined"]
    assert declined
    assert all("could not be corrected" in each and "turned" in each for each in declined)
