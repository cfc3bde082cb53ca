"""Read the settings that the devices of a run reported, from the table of settings of a run file."""

import json
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from dic.runfile import schema

Setting = str | float | int | bool


def settings_of(
    columns: Mapping[str, NDArray[Any]], device: str, moment: schema.Moment
) -> dict[str, Setting]:
    """Return the settings of a device at a moment, by name; empty if the device did not report any.

    `columns`: the columns of the table of settings; empty for a file of an earlier version. `device`: a
    camera's name, "stage", "load_frame" or "interlocks.NAME".

    Raises `ValueError` if a value is not valid JSON.
    """
    if not columns:
        return {}
    wanted = device.encode()[: schema.SETTING_NAME_BYTES]
    chosen = (columns["device"] == wanted) & (columns["moment"] == moment.encode())
    names, values = columns["name"][chosen].tolist(), columns["value"][chosen].tolist()
    return {name.decode(): json.loads(value) for name, value in zip(names, values, strict=True)}
