import pytest

from drivers.errors import ConfigurationError
from rig.protocol.protocol import read_protocol
from rig.rigfile import read_rig
from tests.places import EXAMPLES, example


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("rig-*.toml")), ids=lambda path: path.stem)
def test_every_example_is_read(path):
    rig_file = read_rig(path)
    assert rig_file.text == path.read_text()
    if rig_file.measured_load is not None:
        assert (list(rig_file.cameras), rig_file.stage, rig_file.load_frame) == (["on_axis"], None, None)
        assert rig_file.measured_load.signals == {"load": "force", "displacement": "crosshead"}
        return
    assert list(rig_file.cameras) == ["on_axis", "off_axis"]
    assert (rig_file.stage is None) != (rig_file.load_frame is None)


def test_mistakes_of_all_tables_are_reported_together(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(
        """
        colour = "red"
        [rig]
        nam = "x"
        [simulation]
        driver = "virtual-rig"
        seed = -1
        [cameras.on_axis]
        driver = "simulated-camera"
        tilt_deg = "steep"
        [cameras.off_axis]
        driver = "zaber-ascii"
        [stage]
        driver = "no-such-driver"
        [load_frame]
        address = "@load_frame"
        [recording]
        queue_frames = 0
        """
    )
    with pytest.raises(ConfigurationError) as caught:
        read_rig(path)
    mistakes = "\n".join(caught.value.mistakes)
    assert "colour: unknown key" in mistakes
    assert "rig.nam: unknown key" in mistakes
    assert "rig.name: is missing" in mistakes
    assert "simulation.seed: input should be greater than or equal to 0, got -1" in mistakes
    assert "cameras.on_axis.tilt_deg: input should be a valid number, got 'steep'" in mistakes
    assert (
        "cameras.off_axis.driver: a driver of kind camera is expected, 'zaber-ascii' is one of kind stage"
        in mistakes
    )
    assert "stage.driver: no driver 'no-such-driver' is installed; there are " in mistakes
    assert 'load_frame: a table with driver = "NAME" is expected' in mistakes
    assert "operator: is missing; add it" in mistakes
    assert "recording.queue_frames: input should be greater than or equal to 1, got 0" in mistakes


def test_a_value_in_the_place_of_a_table_is_told_and_truth_is_no_number(tmp_path):
    path = tmp_path / "rig.toml"
    for text, message in (
        ("rig = 3", "rig: a table is expected, got 3"),
        ('[rig]\nname = "x"\nsimulated = 1', "rig.simulated: input should be a valid boolean, got 1"),
    ):
        path.write_text(text)
        with pytest.raises(ConfigurationError) as caught:
            read_rig(path)
        assert message in caught.value.mistakes


def test_rig_without_cameras_is_refused(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('[rig]\nname = "blind"\n[operator]\ndriver = "simulated-operator"\n')
    with pytest.raises(ConfigurationError, match="at least one table"):
        read_rig(path)


@pytest.mark.parametrize("name", ["stage", "load_frame"])
def test_camera_may_not_have_the_name_of_another_device(tmp_path, name):
    path = tmp_path / "rig.toml"
    path.write_text(example("rig-virtual-tension", ("[cameras.off_axis]", f"[cameras.{name}]")))
    with pytest.raises(ConfigurationError, match=f"cameras.{name}: a name other than stage and load_frame"):
        read_rig(path)


def test_a_camera_has_a_name_that_a_program_can_use(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(example("rig-virtual-tension", ("[cameras.off_axis]", '[cameras."off axis/2"]')))
    with pytest.raises(ConfigurationError, match=r"cameras.off axis/2: a name of letters, digits and _"):
        read_rig(path)


def test_protocol_in_the_place_of_a_rig_file_is_told_and_the_other_way_round(tmp_path):
    (tmp_path / "p.toml").write_text('title = "pull"\nkind = "tension"\n')
    (tmp_path / "r.toml").write_text('[rig]\nname = "one"\n')
    with pytest.raises(ConfigurationError, match=r"p\.toml: expected a rig file, got a protocol"):
        read_rig(tmp_path / "p.toml")
    with pytest.raises(ConfigurationError, match=r"r\.toml: expected a protocol, got a rig file"):
        read_protocol(tmp_path / "r.toml")
