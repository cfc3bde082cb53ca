"""`rig verify` knows what an acquisition must have: no grid, any number of images, a ring, all samples."""

from dataclasses import replace

import h5py
import pytest

from rig.commands.verify import verify_run
from tests.rig.engine.test_acquisition import BARE, SHORTEST, beside, with_tables


def test_an_acquisition_without_grid_has_no_problems(tmp_path):
    rig = beside(tmp_path)
    assert rig.engine().run().is_good
    found = verify_run(rig.path)
    assert found.problems == []
    assert (found.steps, found.planned, found.overwritten) == (21, 21, 0)
    assert found.channels["box"].samples > 500
    assert (found.channels["box"].lost, found.channels["box"].outside) == (0, 0)


def test_grid_before_and_after_is_expected_where_it_belongs(tmp_path):
    rig = beside(tmp_path, SHORTEST)
    assert rig.engine().run().is_good
    assert verify_run(rig.path).problems == []
    after = beside(tmp_path / "x", 'grid_images = "after"\nreference = false\n' + SHORTEST)
    after.path.parent.mkdir()
    assert after.engine().run().is_good
    assert verify_run(after.path).problems == []
    with h5py.File(after.path, "r+") as file:
        file["entry/steps/kind"][-1] = b"acquired"
    assert "step of kind grid: 1 expected, 0 on file" in verify_run(after.path).problems


def test_images_that_events_decide_have_no_planned_number(tmp_path):
    rig = beside(
        tmp_path,
        with_tables(
            'increment = { channel = "channels.force", by = 500 }',
            'reaches = { channel = "channels.force", above = 4000 }',
        ),
    )
    assert rig.engine().run().is_good
    found = verify_run(rig.path)
    assert (found.problems, found.planned) == ([], None)


def test_a_ring_has_its_newest_images_and_says_how_many_are_gone(tmp_path):
    rig = beside(tmp_path, with_tables("every_s = 0.5\nkeep_s = 4", "duration_s = 20", BARE))
    outcome = rig.engine().run()
    assert outcome.is_good
    found = verify_run(rig.path)
    assert found.problems == []
    assert found.steps + found.overwritten == outcome.steps_done == 41
    # the reference, and the images of 4 s
    assert found.steps == pytest.approx(1 + 9, abs=1)
    assert found.cameras["on_axis"].valid == found.steps


def test_overwritten_images_of_another_protocol_are_a_problem(tmp_path):
    text = with_tables("every_s = 0.5\nkeep_s = 4", "duration_s = 20", BARE)
    rig = beside(tmp_path, text)
    rig.definition = text.replace("keep_s = 4\n", "")
    assert rig.engine().run().is_good
    assert any("steps were overwritten by later ones" in problem for problem in verify_run(rig.path).problems)


def test_lost_samples_and_samples_out_of_range_are_problems(tmp_path):
    rig = beside(tmp_path, on_read=lambda count, s: replace(s, first=s.first + 3 * (count > 100)))
    outcome = rig.engine().run()
    assert (outcome.status, outcome.is_good) == ("completed", False)
    assert verify_run(rig.path).problems == ["channels.box: 3 samples are missing in 1 gaps"]
    with h5py.File(rig.path, "r+") as file:
        file["entry/channels/box/value_force"][7] = 1e6
    assert (
        "channels.force: 1 samples are out of its range, but the run went on" in verify_run(rig.path).problems
    )


def test_channels_of_the_rig_file_that_are_not_in_the_run_are_missing(tmp_path):
    rig = beside(tmp_path)
    rig.configuration = '[channels.second]\ndriver = "modbus-channels"\n'
    assert rig.engine().run().is_good
    assert verify_run(rig.path).problems == ["channels.second: its samples are missing"]


def test_late_and_missing_images_are_problems(tmp_path):
    good = beside(tmp_path)
    assert good.engine().run().is_good
    timing = verify_run(good.path).timing["on_axis"]
    assert (timing.images, timing.late, timing.missing) == (21, 0, 0)
    assert timing.asked_interval_s == 0.5
    (tmp_path / "x").mkdir()
    slow = beside(tmp_path / "x")
    for camera in slow.cameras.values():
        camera.on_grab = lambda count, frame: (
            slow.clock.sleep(1.18),
            replace(frame, received_s=slow.clock.now_s()),
        )[1]
    outcome = slow.engine().run()
    assert not outcome.is_good
    found = verify_run(slow.path)
    assert found.timing["on_axis"].reached_interval_s == pytest.approx(outcome.timing.reached_s, abs=0.05)
    assert found.timing["on_axis"].missing > 5
    assert any("on_axis: images asked every 0.5 s" in problem for problem in found.problems)
