"""Python calls to the C library libaravis-0.8 of Debian (licence LGPL).

The library is loaded when the program searches for cameras or opens a camera. Source of the function
signatures: Aravis 0.8 reference manual, ArvCamera, ArvStream and ArvBuffer.
"""

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int, c_int64, c_size_t, c_uint, c_uint64, c_void_p
from functools import cache
from typing import Any

LIBRARIES = ("libaravis-0.8.so.0", "libgobject-2.0.so.0", "libglib-2.0.so.0")


class GError(ctypes.Structure):
    """Memory layout of GLib's ``GError``."""

    _fields_ = (("domain", ctypes.c_uint32), ("code", c_int), ("message", c_char_p))


class AravisError(Exception):
    """An error reported by Aravis."""


# Functions that can fail: name, result type, and argument types without the last argument, a GError**.
_FALLIBLE: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_camera_new": (c_void_p, (c_char_p,)),
    "arv_camera_create_stream": (c_void_p, (c_void_p, c_void_p, c_void_p)),
    "arv_camera_get_vendor_name": (c_char_p, (c_void_p,)),
    "arv_camera_get_model_name": (c_char_p, (c_void_p,)),
    "arv_camera_get_device_serial_number": (c_char_p, (c_void_p,)),
    "arv_camera_get_payload": (c_uint, (c_void_p,)),
    "arv_camera_set_region": (None, (c_void_p, c_int, c_int, c_int, c_int)),
    "arv_camera_get_region": (None, (c_void_p, *(POINTER(c_int),) * 4)),
    "arv_camera_set_pixel_format_from_string": (None, (c_void_p, c_char_p)),
    "arv_camera_get_pixel_format_as_string": (c_char_p, (c_void_p,)),
    "arv_camera_set_acquisition_mode": (None, (c_void_p, c_int)),
    "arv_camera_clear_triggers": (None, (c_void_p,)),
    "arv_camera_set_frame_rate": (None, (c_void_p, c_double)),
    "arv_camera_get_frame_rate": (c_double, (c_void_p,)),
    "arv_camera_set_exposure_time": (None, (c_void_p, c_double)),
    "arv_camera_get_exposure_time": (c_double, (c_void_p,)),
    "arv_camera_set_gain": (None, (c_void_p, c_double)),
    "arv_camera_get_gain": (c_double, (c_void_p,)),
    "arv_camera_is_feature_available": (c_int, (c_void_p, c_char_p)),
    "arv_camera_gv_get_packet_size": (c_uint, (c_void_p,)),
    "arv_camera_set_string": (None, (c_void_p, c_char_p, c_char_p)),
    "arv_camera_get_string": (c_char_p, (c_void_p, c_char_p)),
    "arv_camera_set_boolean": (None, (c_void_p, c_char_p, c_int)),
    "arv_camera_get_boolean": (c_int, (c_void_p, c_char_p)),
    "arv_camera_get_integer": (c_int64, (c_void_p, c_char_p)),
    "arv_camera_execute_command": (None, (c_void_p, c_char_p)),
    "arv_camera_start_acquisition": (None, (c_void_p,)),
    "arv_camera_stop_acquisition": (None, (c_void_p,)),
}
_SAFE: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_buffer_new_allocate": (c_void_p, (c_size_t,)),
    "arv_buffer_get_status": (c_int, (c_void_p,)),
    "arv_buffer_get_frame_id": (c_uint64, (c_void_p,)),
    "arv_buffer_get_timestamp": (c_uint64, (c_void_p,)),
    "arv_buffer_get_system_timestamp": (c_uint64, (c_void_p,)),
    "arv_buffer_get_data": (c_void_p, (c_void_p, POINTER(c_size_t))),
    "arv_buffer_get_image_width": (c_int, (c_void_p,)),
    "arv_buffer_get_image_height": (c_int, (c_void_p,)),
    "arv_camera_is_gv_device": (c_int, (c_void_p,)),
    "arv_camera_get_device": (c_void_p, (c_void_p,)),
    "arv_gv_device_is_controller": (c_int, (c_void_p,)),
    "arv_stream_push_buffer": (None, (c_void_p, c_void_p)),
    "arv_stream_timeout_pop_buffer": (c_void_p, (c_void_p, c_uint64)),
    "arv_update_device_list": (None, ()),
    "arv_get_n_devices": (c_uint, ()),
    **{
        f"arv_get_device_{fact}": (c_char_p, (c_uint,))
        for fact in ("id", "vendor", "model", "serial_nbr", "protocol", "address")
    },
}


class Aravis:
    """Calls functions of the Aravis library by name. Functions that can fail raise `AravisError`."""

    def __init__(self, library: Any, gobject: Any, glib: Any) -> None:
        self._library = library
        self._unref = gobject.g_object_unref
        self._unref.argtypes, self._unref.restype = (c_void_p,), None
        self._free_error = glib.g_error_free
        self._free_error.argtypes, self._free_error.restype = (c_void_p,), None
        for name, (result, arguments) in _FALLIBLE.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, (*arguments, POINTER(POINTER(GError)))
        for name, (result, arguments) in _SAFE.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments

    def call(self, name: str, *arguments: Any) -> Any:
        """Call the function of the library that has the prefix ``arv_`` before `name`.

        Raise `AravisError` if the function reports an error. The exception has the library's message.
        """
        name = f"arv_{name}"
        function = getattr(self._library, name)
        if name not in _FALLIBLE:
            return function(*arguments)
        error = POINTER(GError)()
        result = function(*arguments, ctypes.byref(error))
        if error:
            message = (error.contents.message or b"no reason given").decode("utf-8", "replace")
            self._free_error(error)
            raise AravisError(message)
        return result

    def text(self, name: str, *arguments: Any) -> str:
        """Call a function that returns text. Return an empty text for a null pointer."""
        return (self.call(name, *arguments) or b"").decode("utf-8", "replace")

    def release(self, thing: int | None) -> None:
        """Release a reference to an object of the library."""
        if thing:
            self._unref(thing)


@cache
def load() -> Aravis:
    """Load Aravis and the libraries of GLib. Raise `OSError` if a library is not installed."""
    return Aravis(*(ctypes.CDLL(name) for name in LIBRARIES))
