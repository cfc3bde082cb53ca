"""Aravis' GigE Vision camera with prepared pictures: ``python -m …gige.speckle_camera FILE``.

The camera is that of `arv-fake-gv-camera`: its protocol, its stream and its register map are those of Aravis.
Only what it films comes from FILE (see `tests.real_cameras.pictures`). A line on standard input is the number
of the picture that it films from then on. With the trigger "Software" it films at each further line
``trigger``, as if a line of the camera gave a pulse. It ends with the input.
"""

import ctypes
import sys
from itertools import count

import numpy as np

from tests.real_cameras.pictures import drawn

TRIGGER_SOFTWARE = 0x30C
"""Register of the command TriggerSoftware in Aravis' description of the camera."""

FillPattern = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


def main() -> None:
    """Film until the end of the input."""
    pictures = np.load(sys.argv[1])
    aravis = ctypes.CDLL("libaravis-0.8.so.0")
    gobject = ctypes.CDLL("libgobject-2.0.so.0")
    aravis.arv_gv_fake_camera_new.restype = ctypes.c_void_p
    aravis.arv_gv_fake_camera_get_fake_camera.restype = ctypes.c_void_p
    aravis.arv_gv_fake_camera_get_fake_camera.argtypes = [ctypes.c_void_p]
    aravis.arv_fake_camera_set_fill_pattern.argtypes = [ctypes.c_void_p, FillPattern, ctypes.c_void_p]
    aravis.arv_buffer_get_data.restype = ctypes.c_void_p
    aravis.arv_buffer_get_data.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    aravis.arv_fake_camera_get_payload.restype = ctypes.c_size_t
    aravis.arv_fake_camera_get_payload.argtypes = [ctypes.c_void_p]
    aravis.arv_fake_camera_write_register.argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32]
    gobject.g_object_unref.argtypes = [ctypes.c_void_p]
    numbers, films = count(), [0]

    @FillPattern
    def fill(buffer: int, _data: int, _exposure_us: int, _gain: int, _format: int) -> None:
        image = drawn(pictures, films[0], next(numbers))
        # at another size than that of the pictures it films nothing
        if aravis.arv_fake_camera_get_payload(sensor) == image.nbytes:
            ctypes.memmove(aravis.arv_buffer_get_data(buffer, None), image.ctypes.data, image.nbytes)

    camera = aravis.arv_gv_fake_camera_new(b"127.0.0.1", b"GV77")
    sensor = aravis.arv_gv_fake_camera_get_fake_camera(camera)
    aravis.arv_fake_camera_set_fill_pattern(sensor, fill, None)
    for line in sys.stdin:
        if line == "trigger\n":
            aravis.arv_fake_camera_write_register(sensor, TRIGGER_SOFTWARE, 1)
        else:
            films[0] = int(line)
    gobject.g_object_unref(camera)


if __name__ == "__main__":
    main()
