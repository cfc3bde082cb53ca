"""The machines of a rig that can move, those of them that the guardian watches, and warnings to the user."""

from rig.rigfile import DeviceEntry, RigFile


def machines(rig_file: RigFile) -> list[DeviceEntry]:
    """Return the rig file's entries of stage and load frame, except devices simulated inside this program."""
    entries = [entry for entry in (rig_file.load_frame, rig_file.stage) if entry is not None]
    return [entry for entry in entries if not _inside(entry)]


def watched(rig_file: RigFile) -> list[DeviceEntry]:
    """Return the entries of the machines that a guardian can stop."""
    return [entry for entry in machines(rig_file) if entry.spec.guard is not None]


def shared_line(entry: DeviceEntry) -> str:
    """Return the name of a machine's line, which only one program may use, or an empty text if unknown."""
    return "" if entry.spec.guard is None else entry.spec.guard.line(entry.settings)


def cautions(rig_file: RigFile) -> list[str]:
    """Return one sentence for each danger that the rig file accepts. Every start of a run prints them."""
    sentences = [
        f"{entry.name}: {sentence}"
        for entry in (rig_file.load_frame, rig_file.stage)
        if entry is not None and entry.spec.cautions is not None
        for sentence in entry.spec.cautions(entry.settings)
    ]
    return sentences + [
        f"{entry.name}: no guardian can stop it, because its driver {entry.driver!r} does not support one: "
        "if this program dies or hangs, a motion goes on until the emergency stop is pressed"
        for entry in machines(rig_file)
        if entry.spec.guard is None
    ]


def _inside(entry: DeviceEntry) -> bool:
    """Return True if the device is simulated inside this program."""
    values = entry.settings.model_dump().values()
    return any(isinstance(value, str) and value.startswith("@") for value in values)
