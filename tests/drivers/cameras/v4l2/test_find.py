"""The driver finds the video nodes in a simulated system folder."""

from pathlib import Path

from drivers.cameras.v4l2.find import video_nodes
from drivers.registry import Found


def test_of_a_cameras_names_its_sockets_is_taken(tmp_path):
    folder = tmp_path / "sys/class/video4linux/video0"
    folder.mkdir(parents=True)
    for kind in ("by-id", "by-path"):
        links = tmp_path / "dev/v4l" / kind
        links.mkdir(parents=True)
        (links / "camera").symlink_to("../../video0")
    assert [node.place for node in video_nodes(tmp_path)] == [str(tmp_path / "dev/v4l/by-path/camera")]


def test_video_nodes_are_named_by_what_lasts(tmp_path):
    nodes = {"video0": ("0", "USB camera"), "video1": ("1", "USB camera"), "video10": ("0", "second")}
    for name, (index, label) in nodes.items():
        folder = tmp_path / "sys/class/video4linux" / name
        folder.mkdir(parents=True)
        (folder / "index").write_text(index + "\n")
        (folder / "name").write_text(label + "\n")
    links = tmp_path / "dev/v4l/by-id"
    links.mkdir(parents=True)
    (links / "usb-Camera_1234-video-index0").symlink_to("../../video0")
    assert video_nodes(tmp_path) == [
        Found("USB camera", {"device": str(links / "usb-Camera_1234-video-index0")}),
        Found("second", {"device": "/dev/video10"}),
    ]
    assert video_nodes(Path("/nowhere")) == []
