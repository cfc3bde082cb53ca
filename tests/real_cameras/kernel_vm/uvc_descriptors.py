"""The USB descriptors of the simulated USB camera.

Sources: USB 2.0 specification, chapter 9.6; USB Video Class 1.0, chapters 3 and 3.9; USB Video Payload
Uncompressed, chapter 3.
"""

import struct

WIDTH, HEIGHT, RATE_HZ = 320, 240, 30
SERIAL = "OFX-0042"
CAMERA_UNIT, PROCESSING_UNIT, OUTPUT_UNIT = 1, 2, 3
PAYLOAD_BYTES = 16384
ENDPOINT = 0x81
STRINGS = ("", "Optics of the test", "Mono UVC camera", SERIAL)
FORMATS = ("Y800", "Y12 ")
"""Pixel formats by their number in the descriptor, from 1; GREY and Y12 are the names in Linux."""
BYTES_PER_PIXEL = (1, 2)
_VIDEO, _CONTROL, _STREAMING, _INTERFACE = 0x0E, 1, 2, 0x24


def device() -> bytes:
    """Return the device descriptor; its numbers of vendor and product belong to no real device."""
    return struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0xEF, 2, 1, 64, 0xFFF0, 0x0042, 0x0107, 1, 2, 3, 1)


def string(index: int) -> bytes:
    """Return a string descriptor; number 0 lists the languages."""
    text = struct.pack("<H", 0x0409) if index == 0 else STRINGS[index].encode("utf-16-le")
    return struct.pack("<BB", len(text) + 2, 3) + text


def configuration() -> bytes:
    """Return the configuration descriptor with all interfaces, units, formats and the endpoint."""
    body = struct.pack("<BBBBBBBB", 8, 11, 0, 2, _VIDEO, 3, 0, 0)
    body += struct.pack("<BBBBBBBBB", 9, 4, 0, 0, 0, _VIDEO, _CONTROL, 0, 0) + _units()
    body += struct.pack("<BBBBBBBBB", 9, 4, 1, 0, 1, _VIDEO, _STREAMING, 0, 0) + _formats()
    body += struct.pack("<BBBBHB", 7, 5, ENDPOINT, 2, 512, 0)
    return struct.pack("<BBHBBBBB", 9, 2, len(body) + 9, 2, 1, 0, 0x80, 250) + body


def _units() -> bytes:
    # auto-exposure mode, its priority, exposure time; backlight compensation, gain, power line
    camera = struct.pack("<BBBBHBBHHHB", 18, _INTERFACE, 2, CAMERA_UNIT, 0x0201, 0, 0, 0, 0, 0, 3) + bytes(
        [0x0E, 0, 0]
    )
    controls = 1 << 8 | 1 << 9 | 1 << 10
    processing = struct.pack("<BBBBBHBHB", 11, _INTERFACE, 5, PROCESSING_UNIT, CAMERA_UNIT, 0, 2, controls, 0)
    output = struct.pack("<BBBBHBBB", 9, _INTERFACE, 3, OUTPUT_UNIT, 0x0101, 0, PROCESSING_UNIT, 0)
    units = camera + processing + output
    return struct.pack("<BBBHHIBB", 13, _INTERFACE, 1, 0x0100, 13 + len(units), 1_000_000, 1, 1) + units


def _formats() -> bytes:
    formats = b""
    for number, (code, size) in enumerate(zip(FORMATS, BYTES_PER_PIXEL, strict=True), 1):
        guid = code.encode() + bytes.fromhex("00001000800000aa00389b71")
        formats += struct.pack("<BBBBB16sBBBBBB", 27, _INTERFACE, 4, number, 1, guid, 8 * size, 1, 0, 0, 0, 0)
        frame_bytes, interval = WIDTH * HEIGHT * size, 10_000_000 // RATE_HZ
        bits = frame_bytes * 8 * RATE_HZ
        formats += struct.pack(
            "<BBBBBHHIIIIBI",
            *(30, _INTERFACE, 5, 1, 0, WIDTH, HEIGHT, bits, bits, frame_bytes, interval, 1, interval),
        )
    size = 13 + len(FORMATS)
    header = struct.pack(
        "<BBBBHBBBBBBB",
        size,
        _INTERFACE,
        1,
        len(FORMATS),
        size + len(formats),
        ENDPOINT,
        0,
        OUTPUT_UNIT,
        0,
        0,
        0,
        1,
    )
    return header + bytes(len(FORMATS)) + formats
