"""Producers are found in files, folders and the variable that makers' installers set."""

import sys

import pytest

from drivers.cameras.gentl.camera import open_camera
from drivers.cameras.gentl.find import gentl_cameras, remedy
from drivers.cameras.gentl.producers import producers
from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import OpenContext
from tests.drivers.cameras.fake_gentl import settings


def test_producers_are_files_or_all_files_of_a_folder(tmp_path, monkeypatch):
    one, two = tmp_path / "one.cti", tmp_path / "two.cti"
    for file in (one, two, tmp_path / "readme.txt"):
        file.touch()
    assert producers([str(one)]) == [str(one)]
    assert producers([str(tmp_path)]) == [str(one), str(two)]
    monkeypatch.setenv("GENICAM_GENTL64_PATH", f"{tmp_path}:")
    assert producers([]) == [str(one), str(two)]
    with pytest.raises(FileNotFoundError, match=r"no such file: .*three\.cti"):
        producers([str(tmp_path / "three.cti")])


def test_without_a_producer_there_is_a_remedy(tmp_path, monkeypatch):
    monkeypatch.delenv("GENICAM_GENTL64_PATH", raising=False)
    with pytest.raises(OSError, match="GENICAM_GENTL64_PATH, which is not set"):
        gentl_cameras()
    with pytest.raises(DeviceError, match=r"load producer: .*no \.cti file in .*; give the \.cti file"):
        open_camera(settings(cti=str(tmp_path)), OpenContext("camera", SystemClock()))


def test_without_the_packages_a_machine_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "harvesters.core", None)
    (tmp_path / "maker.cti").touch()
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(tmp_path))
    with pytest.raises(OSError, match=r"no search without Harvesters .*pip install 'offaxis\[gentl\]'"):
        gentl_cameras()
    with pytest.raises(DeviceError, match=r"load Harvesters: .*pip install 'offaxis\[gentl\]'"):
        open_camera(settings(), OpenContext("camera", SystemClock()))


def test_a_missing_shared_library_of_python_is_named():
    error = ImportError("libpython3.11.so.1.0: cannot open shared object file: No such file or directory")
    assert remedy(error).endswith(f"apt install libpython3.{sys.version_info.minor}")


def test_a_file_that_is_no_producer_is_told(tmp_path):
    pytest.importorskip("harvesters.core", reason="pip install 'offaxis[gentl]'", exc_type=ImportError)
    (tmp_path / "maker.cti").write_text("not a library")
    with pytest.raises(DeviceError, match=r"load producer: expected a GenTL producer, got .*too short"):
        open_camera(settings(cti=str(tmp_path)), OpenContext("camera", SystemClock()))


def test_simulated_time_is_refused():
    with pytest.raises(DeviceFault, match="use driver 'simulated-camera' in a simulated rig"):
        open_camera(settings(), OpenContext("camera", VirtualClock()))
