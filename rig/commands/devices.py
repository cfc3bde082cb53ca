"""The output of ``rig devices``: lines to print, a table for JSON, and a rig file that the user completes."""

from typing import Any

from drivers.settings import toml_table
from rig.commands.device_search import Device, DevicePlace, Search

# For each kind of device: the settings that the user must decide, and the basis for the decision.
_TO_DECIDE = {
    "camera": (
        ("format", "width_px", "height_px", "rate_hz", "exposure_us"),
        "as the camera offers and the test needs",
    ),
    "stage": (("angle_min_deg", "angle_max_deg"), "how far the stage may turn"),
    "load_frame": (("load_max_n", "displacement_max_mm"), "what the specimen and the machine may bear"),
    "interlock": (("allowed_min", "allowed_max"), "within which values a run may go on"),
    "channels": (("rate_hz", "signals"), "what is wired to the inputs, with unit, scale and range"),
    "trigger": ((), "the output that gives the pulse, and at which event"),
}
# Devices of these kinds have tables with names of their own, of which a rig may have many: for each kind the
# group of the tables, and the beginning of the names.
_NAMED = {
    "camera": ("cameras", "camera"),
    "interlock": ("interlocks", "interlock"),
    "channels": ("channels", "box"),
    "trigger": ("triggers", "line"),
}


def lines(search: Search) -> list[str]:
    """Return the result of a search as lines of text."""
    cameras, others = _cameras_and_others(search.devices)
    said = [] if cameras else ["no camera"]
    for each in [*cameras, *others]:
        kind = each.spec.kind.replace("_", " ")
        said.append(f"{kind} {each.found.place}: {each.found.what or 'no name'}")
    said += [f"{each.what}: {each.why}" for each in search.unsearched]
    said += [f"left out: {why}" for why in search.unloaded]
    for port in search.ports:
        who = _who(port) or "no known device answers"
        said.append(f"serial port {port.address} ({port.description}): {who}")
    if not search.ports:
        said.append("no serial port")
    said += [f"Modbus at {host.address}: {_who(host) or 'no device answers'}" for host in search.modbus]
    return said


def table(search: Search) -> dict[str, Any]:
    """Return the result of a search as a table for JSON."""
    cameras, others = _cameras_and_others(search.devices)
    cameras_unsearched = [each.why for each in search.unsearched if each.kind == "camera"]
    return {
        "cameras": [
            {"driver": each.driver, "place": each.found.place, "name": each.found.what} for each in cameras
        ],
        "cameras_not_looked_for": "; ".join(cameras_unsearched),
        "other_devices": [_device_table(each) for each in others],
        "drivers_not_loaded": search.unloaded,
        "serial_ports": [
            {"path": port.address, "description": port.description, **_answer_table(port)}
            for port in search.ports
        ],
        "modbus": [{"address": host.address, **_answer_table(host)} for host in search.modbus],
    }


def rig_file(search: Search) -> str:
    """Return a rig file with all found devices. Comments name the settings that the user must decide."""
    parts = [
        "# Made by `rig devices`. Fill in what is left open: `rig check` names what is missing.",
        '[rig]\nname = "my rig"',
    ]
    answered = [each for place in [*search.ports, *search.modbus] for each in place.devices]
    cameras, others = _cameras_and_others([*search.devices, *answered])
    for kind, (group, name) in _NAMED.items():
        of_kind = [each for each in (*cameras, *others) if each.spec.kind == kind]
        parts += [
            _rig_table([group, f"{name}_{number}"], each, usable=each.found.usable)
            for number, each in enumerate(of_kind)
        ]
        if kind == "camera" and not of_kind:
            parts.append("# No camera was found: add [cameras.NAME] for each.")
    used: set[str] = set()
    for each in (other for other in others if other.spec.kind not in _NAMED):
        # a rig has at most one stage and one load frame, so more devices of these kinds become comments
        usable = each.found.usable and each.spec.kind not in used
        parts.append(_rig_table([each.spec.kind], each, usable=usable))
        used |= {each.spec.kind} if usable else set()
    parts.append('[operator]\ndriver = "console-operator"')
    return "\n\n".join(parts) + "\n"


def _cameras_and_others(devices: list[Device]) -> tuple[list[Device], list[Device]]:
    cameras = [each for each in devices if each.spec.kind == "camera"]
    return cameras, [each for each in devices if each.spec.kind != "camera"]


def _who(place: DevicePlace) -> str:
    return "; ".join(each.found.what for each in place.devices) or place.trouble


def _answer_table(place: DevicePlace) -> dict[str, Any]:
    return {"found": [_device_table(each) for each in place.devices], "trouble": place.trouble}


def _device_table(device: Device) -> dict[str, Any]:
    return {
        "kind": device.spec.kind,
        "driver": _driver(device),
        "what": device.found.what,
        "settings": dict(device.found.settings),
    }


def _driver(device: Device) -> str:
    """Return the name of the driver that can open a device, or an empty text if no driver can."""
    return device.driver if device.found.usable else ""


def _rig_table(names: list[str], device: Device, *, usable: bool) -> str:
    """Return a device's table for a rig file. If the device is not usable, all lines are comments."""
    # a line break in a device's name must not end the comment
    what = "".join(sign if sign.isprintable() else " " for sign in device.found.what)
    settings = {"driver": _driver(device), **device.found.settings}
    text = "\n".join([f"# {what}", toml_table(names, settings), *_left_open(device)])
    if usable:
        return text
    return "\n".join(line if line.startswith("#") else f"# {line}" for line in text.split("\n"))


def _left_open(device: Device) -> list[str]:
    """Return a comment that names the settings that the user must decide."""
    usual, reason = _TO_DECIDE.get(device.spec.kind, ((), "they have no default"))
    fields = device.spec.settings.model_fields
    names = [name for name in usual if name in fields]
    names += [name for name, each in fields.items() if each.is_required() and name not in names]
    names = [name for name in names if name not in device.found.settings]
    return [f"# {', '.join(names)}: {reason}"] if names else []
