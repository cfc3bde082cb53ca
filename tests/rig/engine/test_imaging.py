"""Old images, images with error flags and images of another format are not recorded."""

from dataclasses import replace


def test_stale_image_is_refused(tension):
    tension.cameras["on_axis"].on_grab = lambda count, frame: replace(frame, exposed_s=frame.exposed_s - 1.4)
    outcome = tension.engine().run()
    assert (
        "expected an image exposed after it was asked for, got one exposed 1.400 s before" in outcome.reason
    )


def test_flagged_image_is_taken_again_and_noted(tension):
    tension.cameras["on_axis"].on_grab = lambda count, frame: replace(frame, flags=0x40 if count == 2 else 0)
    assert tension.engine().run().status == "completed"
    assert "cameras.on_axis: step 1 (reference): image dropped: one with the flags 0x40" in tension.events()


def test_camera_that_flags_every_image_ends_the_run(tension):
    tension.cameras["on_axis"].on_grab = lambda count, frame: replace(frame, flags=0x40)
    assert "got one with the flags 0x40, the last of 3 attempts" in tension.engine().run().reason


def test_image_of_unannounced_format_is_refused(tension):
    tension.cameras["on_axis"].on_grab = lambda count, frame: replace(frame, image=frame.image[:3])
    assert "expected an image of 8 x 6 px as uint8, got shape (3, 8)" in tension.engine().run().reason
