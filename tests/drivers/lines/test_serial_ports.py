"""The search finds the serial ports in a simulated system folder."""

import serial.tools.list_ports
from serial.tools.list_ports_common import ListPortInfo

from drivers.lines.serial_ports import serial_ports


def test_serial_ports_are_named_by_what_lasts(tmp_path, monkeypatch):
    links = {
        "by-id/usb-FTDI_A1-if00": "ttyUSB0",
        "by-id/usb-1a86_USB_Serial-if00": "ttyUSB2",
        "by-path/pci-usb-0:1": "ttyUSB0",
        "by-path/pci-usb-0:2": "ttyUSB1",
        "by-path/pci-usb-0:3": "ttyUSB2",
    }
    for name, node in links.items():
        link = tmp_path / "dev/serial" / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(f"../../{node}")
    # two adapters of a kind without a serial number share one name in by-id
    plugged = {"ttyUSB0": "A1", "ttyUSB1": None, "ttyUSB2": None}
    ports = [ListPortInfo(f"/dev/{name}") for name in plugged]
    for port, number in zip(ports, plugged.values(), strict=True):
        port.serial_number = number
    monkeypatch.setattr(serial.tools.list_ports, "comports", lambda: ports)
    found = [port.path.removeprefix(f"{tmp_path}/dev/serial/") for port in serial_ports(tmp_path)]
    assert found == ["by-id/usb-FTDI_A1-if00", "by-path/pci-usb-0:2", "by-path/pci-usb-0:3"]
