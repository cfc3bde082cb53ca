"""The finished steps of a run, and the rows of their images in the tables of the cameras."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import Any, get_args

import numpy as np

from dic.runfile import schema
from dic.runfile.layout import Unlike
from dic.typing import Mask


@dataclass(frozen=True)
class RunStep:
    """A finished step of a run: its target, and the readings of the devices.

    In a run file, these are the readings after the devices have settled. In the results of a camera, they are
    the readings at the middle of the exposures of this camera's images, with standard deviations
    (`dic.runfile.at_exposure`). The reading of a device that the rig does not have is NaN.

    Attributes
    ----------
    index : int
    kind : str
    target, load_n, displacement_mm, angle_deg, time_s : float
    load_std_n, displacement_std_mm, angle_std_deg, time_std_s : float
        Standard deviations, NaN if they are not known.
    load_lag_n : float
        Change of the load if all images of the run were taken later, or the load were delayed less, by one
        standard deviation of these times. The standard deviation of the load contains it.
    due_s, late_s : float
        Time at which the images were due, and by how much later their exposure began; NaN if no clock asked
        for them.
    channels : tuple of ChannelValue
        The values of the other signals.
    """

    index: int
    kind: str
    target: float
    load_n: float
    displacement_mm: float
    angle_deg: float
    time_s: float
    load_std_n: float = nan
    displacement_std_mm: float = nan
    angle_std_deg: float = nan
    time_std_s: float = nan
    load_lag_n: float = nan
    due_s: float = nan
    late_s: float = nan
    channels: "tuple[ChannelValue, ...]" = ()

    def known(self) -> dict[str, Any]:
        """Return all values for tables and JSON, those of the channels under names of their own."""
        values = {name: value for name, value in vars(self).items() if name != "channels"}
        for channel in self.channels:
            values[channel.column()] = channel.value
            values[channel.column("std")] = channel.std
            values[channel.column("lag")] = channel.lag
        return values


@dataclass(frozen=True)
class ChannelValue:
    """The value of a signal at the images of a step.

    `lag` is the change of the value if the images were taken later, or the signal were delayed less, by one
    standard deviation of these times. `std` contains it.
    """

    name: str
    unit: str
    value: float
    std: float = nan
    lag: float = nan

    def column(self, what: str = "") -> str:
        """Return the name of a column of tables, such as "channel_oven_degC" or "channel_oven_std_degC"."""
        return "_".join(filter(None, (CHANNEL, self.name, what, _in_names(self.unit))))


CHANNEL = "channel"
"""Begin of the names of the columns that channels have in tables."""
_WORDS = {"°": "deg", "µ": "u", "\u03bc": "u", "ε": "e", "‰": "permille", "%": "percent", "/": "_per_"}
"""Signs in units, and what stands for them in names of columns."""


def _in_names(unit: str) -> str:
    """Return a unit as a part of a column's name; "" for a number without a unit."""
    text = "".join(_WORDS.get(sign, sign) for sign in ("" if unit == "1" else unit))
    return "".join(sign if sign.isascii() and sign.isalnum() else "_" for sign in text).strip("_")


_KINDS = frozenset(get_args(schema.StepKind))


@dataclass(frozen=True)
class StepTable:
    """The finished steps of a run file, and the rows of each camera's images at them.

    Steps whose images were overwritten by later ones are left out and counted.
    """

    steps: list[RunStep]
    rows: dict[str, list[range]]
    overwritten: int


def read_step_table(table: Any, cameras: Mapping[str, Any]) -> StepTable:
    """Read the table of steps of a run file.

    `cameras`: the groups of the cameras, by name.
    Raises `Unlike` if a step is of an unknown kind, or the rows of its images do not exist.
    """
    steps = _finished_steps(table)
    rows = {name: _rows_of_steps(table, name, len(steps), group) for name, group in cameras.items()}
    kept = np.ones(len(steps), np.bool_)
    for name, group in cameras.items():
        kept &= _not_overwritten(rows[name], group["step"][:])
    own = np.flatnonzero(kept)
    return StepTable(
        [steps[k] for k in own],
        {name: [ranges[k] for k in own] for name, ranges in rows.items()},
        len(steps) - len(own),
    )


def _finished_steps(table: Any) -> list[RunStep]:
    # A row of the table is complete when its last column, `complete`, is set. In the file of a killed run
    # the other columns may have more rows.
    complete = table[schema.COMPLETE.name][:]
    n = int(np.argmin(complete)) if not complete.all() else len(complete)
    items = [*schema.STEP_ITEMS, *([schema.DUE] if schema.DUE.name in table else [])]
    columns = {item.name: table[item.name][:n].tolist() for item in items}
    columns["kind"] = [kind.decode() for kind in columns["kind"]]
    if unknown := set(columns["kind"]) - _KINDS:
        raise Unlike(f"a step of kind {unknown.pop()!r}")
    return [RunStep(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]


def _rows_of_steps(table: Any, camera: str, count: int, group: Any) -> list[range]:
    columns = (table[name(camera)][:count].tolist() for name in (schema.first_row, schema.row_count))
    ranges = [range(first, first + count) for first, count in zip(*columns, strict=True)]
    on_file = len(group[schema.PIXELS])
    for rows in ranges:
        if not 0 <= rows.start <= rows.stop <= on_file:
            raise Unlike(f"images {rows.start} to {rows.stop} of {camera} in a step, of {on_file} on file")
    return ranges


def _not_overwritten(rows: list[range], owners: Any) -> Mask:
    """Return which steps have no image that a later step has overwritten.

    `owners`: for each row of images, the step to which the images belong.
    """
    return np.array([(owners[own.start : own.stop] <= k).all() for k, own in enumerate(rows)], np.bool_)
