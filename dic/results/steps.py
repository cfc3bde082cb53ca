"""Writes and reads the steps of a run in a result file, with the readings at the images of one camera."""

from collections.abc import Sequence
from typing import Any

from dic.results.schema import CHANNEL_COLUMNS, CHANNELS, LATER_STEP_UNITS, STEP_UNITS
from dic.runfile.steps import ChannelValue, RunStep

_KIND, _REMARKS = "kind", "remarks"


def write_steps(camera: Any, steps: Sequence[RunStep], remarks: Sequence[str] = ()) -> None:
    """Write steps into a new group `steps` of the group of a camera. All steps have the same channels."""
    import h5py

    group = camera.create_group("steps")
    texts = h5py.string_dtype()
    group.create_dataset(_KIND, data=[step.kind for step in steps], dtype=texts)
    group.create_dataset(_REMARKS, data=list(remarks), dtype=texts)
    for column, units in (STEP_UNITS | LATER_STEP_UNITS).items():
        data = [getattr(step, column) for step in steps]
        group.create_dataset(column, data=data).attrs["units"] = units
    for k, channel in enumerate(steps[0].channels if steps else ()):
        place = group.create_group(f"{CHANNELS}/{channel.name}")
        place.attrs["unit"] = channel.unit
        for column in CHANNEL_COLUMNS:
            data = [getattr(step.channels[k], column) for step in steps]
            place.create_dataset(column, data=data).attrs["units"] = channel.unit


def read_steps(camera: Any) -> tuple[list[RunStep], list[str]]:
    """Return the steps and the remarks on them that `write_steps` wrote.

    Files of earlier versions have the readings after settling, and no standard deviations, channels and
    remarks.
    """
    group = camera["steps"]
    # Files of earlier versions have the kinds in an attribute, which can hold 4000 of them only.
    kinds = group[_KIND].asstr()[:] if _KIND in group else group.attrs[_KIND]
    own = [column for column in (*STEP_UNITS, *LATER_STEP_UNITS) if column in STEP_UNITS or column in group]
    columns = {column: group[column][:].tolist() for column in own}
    channels = _read_channels(group[CHANNELS]) if CHANNELS in group else [()] * len(kinds)
    steps = []
    for k, kind in enumerate(kinds):
        values: dict[str, Any] = {column: float(each[k]) for column, each in columns.items()}
        values["index"] = int(columns["index"][k])
        steps.append(RunStep(kind=str(kind), channels=channels[k], **values))
    remarks = [str(text) for text in group[_REMARKS].asstr()[:]] if _REMARKS in group else []
    return steps, remarks


def _read_channels(group: Any) -> list[tuple[ChannelValue, ...]]:
    """Return the values of all channels at each step."""
    of_channels = []
    for name in group:
        columns = (group[name][column][:].tolist() for column in CHANNEL_COLUMNS)
        unit = str(group[name].attrs["unit"])
        of_channels.append([ChannelValue(name, unit, *values) for values in zip(*columns, strict=True)])
    return list(zip(*of_channels, strict=True))
