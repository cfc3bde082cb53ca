"""A simulated USB camera in a separate process, connected to the kernel by USB/IP (`vhci-hcd`).

The camera films speckles, which become brighter with exposure time and gain. It writes its number and the
start of its exposure into each picture. Commands are lines on standard input. ``lose N``, ``damage N`` and
``cut N`` spoil the next N pictures. ``stall 1`` stops the camera, and ``stall 0`` lets it continue. ``refuse
1`` makes it refuse settings. At the end of the input the camera is unplugged. The program then prints the
spoilt pictures and the settings as JSON.

Sources: Linux Documentation/usb/usbip_protocol.rst; USB Video Class 1.0, chapter 4 and 2.4.3.
"""

import json
import os
import select
import socket
import struct
import sys
import time
from collections import deque
from pathlib import Path

import numpy as np

from tests.real_cameras.kernel_vm import uvc_descriptors as usb

SUBMIT, UNLINK, SUBMITTED, UNLINKED = 1, 2, 3, 4
STALL, UNLINKED_STATUS = -32, -104
HIGH_SPEED = 3
VHCI = Path("/sys/devices/platform/vhci_hcd.0")
HEADER = 12
NUMBER_BITS, TIME_BITS = 32, 64
PERIOD_S = 1 / usb.RATE_HZ
LATEST_S = 0.025
"""Largest delay in s of the first packet of a picture after the exposure; a later picture is not sent."""
SET_CUR = 0x01
GET_CUR, GET_MIN, GET_MAX, GET_RES, GET_LEN, GET_INFO, GET_DEF = range(0x81, 0x88)
AUTO_MODE, EXPOSURE, GAIN = (usb.CAMERA_UNIT, 2), (usb.CAMERA_UNIT, 4), (usb.PROCESSING_UNIT, 4)
MANUAL, APERTURE_PRIORITY = 1, 8
OUT_OF_RANGE = b"\x04"


class Knob:
    """A control of the camera: its size in bytes, and its present, lowest, highest and default value."""

    def __init__(self, size: int, minimum: int, maximum: int, default: int, resolution: int = 1) -> None:
        self.size, self.value = size, default
        self.answers = {GET_MIN: minimum, GET_MAX: maximum, GET_DEF: default, GET_RES: resolution}


class UvcDevice:
    """The simulated camera on one USB/IP connection to the kernel."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._knobs = {
            AUTO_MODE: Knob(1, MANUAL, APERTURE_PRIORITY, APERTURE_PRIORITY, MANUAL | APERTURE_PRIORITY),
            (usb.CAMERA_UNIT, 3): Knob(1, 0, 1, 1),
            EXPOSURE: Knob(4, 1, 5000, 156),
            (usb.PROCESSING_UNIT, 1): Knob(2, 0, 2, 1),
            GAIN: Knob(2, 0, 255, 64),
            (usb.PROCESSING_UNIT, 5): Knob(1, 0, 2, 1),
        }
        self._format = 1
        self._waiting: deque[tuple[int, int]] = deque()
        self._payloads: deque[bytes] = deque()
        self._number = 0
        self._toggle = 0
        self._begin_s = time.monotonic()
        self._to_come = {"lose": 0, "damage": 0, "cut": 0, "stall": 0, "refuse": 0}
        self.spoilt: dict[str, list[int]] = {"lose": [], "damage": [], "cut": []}
        speckles = np.random.default_rng(3).random((usb.HEIGHT // 4, usb.WIDTH // 4))
        self._scene = np.kron(speckles, np.ones((4, 4)))

    def settings(self) -> list[int]:
        """Return the values of mode, priority, exposure, backlight, gain and power line, in this order."""
        return [knob.value for knob in self._knobs.values()]

    def serve(self) -> None:
        """Film and answer requests until the input ends or the kernel closes the connection."""
        while True:
            wait_s = max(0.0, self._begin_s + self._exposed_s() - time.monotonic())
            ready, _, _ = select.select([self._link, sys.stdin], [], [], wait_s)
            if sys.stdin in ready:
                line = sys.stdin.readline().split()
                if not line:
                    return
                self._to_come[line[0]] = int(line[1])
            if self._link in ready and not self._answer():
                return
            if time.monotonic() >= self._begin_s + self._exposed_s():
                self._picture()
            self._send()

    def _exposed_s(self) -> float:
        return min(PERIOD_S, self._knobs[EXPOSURE].value * 1e-4)

    def _picture(self) -> None:
        number, begin_s = self._number, self._begin_s
        # a sensor goes on at its own pace, whoever listens; what this process sleeps through is lost
        exposed = max(1, int((time.monotonic() - begin_s) / PERIOD_S))
        self._begin_s += PERIOD_S * exposed
        self._number += exposed
        self.spoilt["lose"].extend(range(number + 1, number + exposed))
        if self._to_come["stall"] or not self._waiting:
            return
        if self._payloads:  # the last one is still on its way
            self.spoilt["lose"].append(number)
            return
        data = self._draw(number, begin_s)
        if time.monotonic() - begin_s - self._exposed_s() > LATEST_S:
            self.spoilt["lose"].append(number)
            return
        spoil = next((kind for kind in self.spoilt if self._to_come[kind]), None)
        if spoil:
            self._to_come[spoil] -= 1
            self.spoilt[spoil].append(number)
        if spoil == "lose":
            return
        if spoil == "cut":
            data = data[: len(data) // 2]
        room = usb.PAYLOAD_BYTES - HEADER
        pieces = [data[at : at + room] for at in range(0, len(data), room)]
        for piece in pieces:
            flags = (
                0x80 | self._toggle | (2 if piece is pieces[-1] else 0) | (0x40 if spoil == "damage" else 0)
            )
            self._payloads.append(bytes([HEADER, flags]) + bytes(HEADER - 2) + piece)
        self._toggle ^= 1

    def _draw(self, number: int, begin_s: float) -> bytes:
        deep = self._format > 1
        light = self._knobs[EXPOSURE].value / 100 * (1 + self._knobs[GAIN].value / 64)
        top = 4095 if deep else 255
        image = np.minimum(top, self._scene * light / 6 * top).astype("<u2" if deep else "u1")
        for row, (value, bits) in enumerate([(number, NUMBER_BITS), (round(begin_s * 1e6), TIME_BITS)]):
            image[row, :bits] = [top if value >> bit & 1 else 0 for bit in range(bits)]
        return image.tobytes()

    def _send(self) -> None:
        while self._waiting and self._payloads:
            sequence, room = self._waiting.popleft()
            data = self._payloads.popleft()
            assert len(data) <= room
            self._reply(sequence, 0, data)

    def _answer(self) -> bool:
        header = self._receive(48)
        if not header:
            return False
        command, sequence, _, to_host, endpoint = struct.unpack(">5I", header[:20])
        if command == UNLINK:
            (other,) = struct.unpack(">I", header[20:24])
            known = [entry for entry in self._waiting if entry[0] == other]
            for entry in known:
                self._waiting.remove(entry)
            status = UNLINKED_STATUS if known else 0
            self._link.sendall(struct.pack(">5Ii24x", UNLINKED, sequence, 0, 0, 0, status))
            return True
        (length,) = struct.unpack(">I", header[24:28])
        data = self._receive(length) if not to_host and length else b""
        if endpoint == 0:
            answer = self._control(header[40:48], data)
            if answer is None:
                self._reply(sequence, STALL, b"")
            else:
                self._reply(sequence, 0, answer[:length], sent=len(data))
        else:
            self._waiting.append((sequence, length))
        return True

    def _reply(self, sequence: int, status: int, data: bytes, sent: int = 0) -> None:
        header = struct.pack(">5IiI4I4x", SUBMITTED, sequence, 0, 0, 0, status, len(data) or sent, 0, 0, 0, 0)
        self._link.sendall(header + data)

    def _receive(self, count: int) -> bytes:
        parts = b""
        while len(parts) < count:
            part = self._link.recv(count - len(parts))
            if not part:
                return b""
            parts += part
        return parts

    def _control(self, setup: bytes, data: bytes) -> bytes | None:
        """Return the answer to a request to endpoint 0, or None for an unknown request."""
        kind, request, value, index, _ = struct.unpack("<BBHHH", setup)
        if kind & 0x60 == 0:
            return self._standard(kind, request, value)
        selector, entity = value >> 8, index >> 8
        if entity == 0 and index & 0xFF == 0:
            return OUT_OF_RANGE if request == GET_CUR else None  # why the last request was refused
        if entity == 0:
            return self._negotiate(request, selector, data)
        knob = self._knobs.get((entity, selector))
        if knob is None:
            return None
        if request == SET_CUR:
            held = (entity, selector) == EXPOSURE and self._knobs[AUTO_MODE].value != MANUAL
            if held or self._to_come["refuse"]:
                return None
            knob.value = int.from_bytes(data, "little")
            return b""
        if request in (GET_INFO, GET_LEN):
            return b"\x03" if request == GET_INFO else struct.pack("<H", knob.size)
        number = knob.value if request == GET_CUR else knob.answers[request]
        return number.to_bytes(knob.size, "little")

    def _standard(self, kind: int, request: int, value: int) -> bytes | None:
        if request == 6:
            index = value & 0xFF
            if value >> 8 == 3:
                return usb.string(index) if index < len(usb.STRINGS) else None
            return {1: usb.device(), 2: usb.configuration()}.get(value >> 8)
        if request == 1 and kind == 2:  # an endpoint that is cleared begins anew
            self._payloads.clear()
        return b"\0\0" if request == 0 else b""

    def _negotiate(self, request: int, selector: int, data: bytes) -> bytes | None:
        if request == SET_CUR:
            self._format = data[2] if data[2] in (1, 2) else 1
            if selector == 2:
                self._payloads.clear()
            return b""
        if request == GET_INFO:
            return b"\x03"
        if request == GET_LEN:
            return struct.pack("<H", 26)
        size = usb.WIDTH * usb.HEIGHT * usb.BYTES_PER_PIXEL[self._format - 1]
        interval = 10_000_000 // usb.RATE_HZ
        return struct.pack(
            "<HBBIHHHHHII", 1, self._format, 1, interval, 0, 0, 0, 0, 0, size, usb.PAYLOAD_BYTES
        )


def main() -> None:
    """Plug the camera in, serve it until the end of the input, and unplug it."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    ours, kernels = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    (VHCI / "attach").write_text(f"{port} {kernels.fileno()} {0x10002 + port} {HIGH_SPEED}")
    kernels.close()
    device = UvcDevice(ours)
    device.serve()
    (VHCI / "detach").write_text(str(port))
    os.close(ours.detach())
    print(json.dumps({"spoilt": device.spoilt, "settings": device.settings()}), flush=True)


if __name__ == "__main__":
    main()
