"""The layout of a run file: all names, types, units and sizes. `docs/run-file.md` explains all names."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

FORMAT = "offaxis-run"
VERSION = 1

RunStatus: TypeAlias = Literal["running", "completed", "aborted", "failed"]
Level: TypeAlias = Literal["info", "warning", "error"]
Moment: TypeAlias = Literal["start", "end"]
"""When the settings of a device were read: before the first image, or at the end of the run."""
StepKind: TypeAlias = Literal[
    "grid",
    "reference",
    "static",
    "load",
    "displacement",
    "rotation",
    "creep",
    "relaxation",
    "rest",
    "acquired",
]
"""Images of a step of kind "acquired" were taken beside a motion that this program does not command."""
FixedFace: TypeAlias = Literal["middle", "back", "front"]
"""What the grips hold in place while the specimen becomes thinner; the cameras see the front."""

GridMaking: TypeAlias = Literal["printed", "glass", "exact"]
"""How the calibration target was made: by a laser printer, as chrome on glass, or without any deviation."""

ROOT_ATTRIBUTES = {"default": "entry", "file_format": FORMAT, "file_format_version": VERSION}


@dataclass(frozen=True)
class Item:
    """The name, type and unit of a dataset in a run file."""

    name: str
    dtype: str
    """The type of a number is the name of a NumPy type. The type of a text is "S", followed by the largest
    number of bytes if the length is limited.
    """
    units: str = ""
    """Unit of a number; "1" for a number without a unit."""

    @property
    def text_bytes(self) -> int | None:
        """Largest number of bytes of a text, or 0 if the length is not limited; None for a number."""
        return int(self.dtype[1:] or 0) if self.dtype.startswith("S") else None


@dataclass(frozen=True)
class GroupLayout:
    """A group in a run file: its NeXus class, its datasets in the order of writing, and its attributes."""

    nx_class: str
    items: tuple[Item, ...] = ()
    attributes: tuple[str, ...] = ()


PROVENANCE = Item("provenance", "S")
CONTINUES = Item("continues", "S")
"""The earlier run that a run continues, as JSON; empty for a run that begins anew."""

SETTINGS = Item("settings", "S")
"""The settings of a device, in the same group as the columns of the device's table."""

DIGEST = Item("digest", "S64")

ORDER = Item("order", "int64", "1")
"""The number of a row among the rows of all tables, in the order in which the run recorded them."""

STAGE_FLAGS = (Item("moving", "uint8", "1"), Item("homed", "uint8", "1"))
LOAD_FRAME_FLAGS = (
    Item("moving", "uint8", "1"),
    Item("at_target", "uint8", "1"),
    Item("holding", "uint8", "1"),
    Item("sample", "int64", "1"),
)

_IDENTITY = ("vendor", "model", "serial", "firmware")

ENTRY = GroupLayout(
    "NXentry",
    (
        Item("title", "S"),
        Item("run_id", "S"),
        Item("definition", "S"),
        Item("configuration", "S"),
        Item("start_time", "S"),
        Item("versions", "S"),
        PROVENANCE,
        CONTINUES,
        Item("end_time", "S40"),
        Item("status", "S16"),
        Item("status_reason", "S480"),
    ),
    ("simulated",),
)
DIRECTION = Item("direction_deg", "float64", "deg")
"""Angle between the load and the rolling direction; NaN if it was not declared, and files of earlier versions
lack it."""
SAMPLE = GroupLayout(
    "NXsample",
    (
        Item("name", "S"),
        Item("thickness_mm", "float64", "mm"),
        Item("width_mm", "float64", "mm"),
        Item("gauge_length_mm", "float64", "mm"),
        DIRECTION,
    ),
)
TARGET = (Item("target", "S16"), Item("marker_mm", "float64", "mm"), Item("dictionary", "S"))
MAKING = (
    Item("grid_made", "S"),
    Item("scale_ratio_std", "float64", "1"),
    Item("skew_std", "float64", "rad"),
    Item("flatness_std_mm", "float64", "mm"),
)
"""How accurately the target was made; files of earlier versions do not say it."""
GRID = GroupLayout(
    "NXcollection", (Item("lines", "int64", "1"), Item("pitch_mm", "float64", "mm"), *TARGET, *MAKING)
)
FIXED_FACE = Item("fixed_face", "S")
MOUNTING_GROUP = "mounting"
"""Name of the group with the declared mounting; files of earlier versions lack this group."""
MOUNTING = GroupLayout(
    "NXcollection",
    (
        Item("plate_mm", "float64", "mm"),
        Item("tilt_axis_mm", "float64", "mm"),
        Item("shift_std_um", "float64", "um"),
        FIXED_FACE,
    ),
)
INSTRUMENT = GroupLayout("NXinstrument")

# Each group below is a table, whose items are columns. The last column is written last. So a row is complete
# if its element in the last column exists.

PIXELS = "data"
"""Name of the dataset of a camera's images, shape (n, height, width), type uint8 or uint16.

This dataset is in the same group as the columns of `DETECTOR`.
"""

PIXELS_ATTRIBUTES = {"units": "1", "interpretation": "image"}

MIDDLE = (Item("middle_s", "float64", "s"), Item("middle_std_s", "float64", "s"))
"""The middle of an exposure and its standard deviation; files of earlier versions lack it."""

DETECTOR = GroupLayout(
    "NXdetector",
    (
        Item("exposed_s", "float64", "s"),
        Item("received_s", "float64", "s"),
        Item("utc_ns", "int64", "ns"),
        Item("sequence", "int64", "1"),
        Item("flags", "int64", "1"),
        Item("exposure_us", "float64", "us"),
        Item("gain", "float64", "1"),
        *MIDDLE,
        Item("step", "int64", "1"),
        DIGEST,
        ORDER,
        Item("valid", "uint8", "1"),
    ),
    (*_IDENTITY, "bits"),
)
STAGE = GroupLayout(
    "NXpositioner",
    (Item("angle_deg", "float64", "deg"), *STAGE_FLAGS, ORDER, Item("time_s", "float64", "s")),
    _IDENTITY,
)
LOAD_FRAME = GroupLayout(
    "NXsensor",
    (
        Item("load_n", "float64", "N"),
        Item("displacement_mm", "float64", "mm"),
        *LOAD_FRAME_FLAGS,
        ORDER,
        Item("time_s", "float64", "s"),
    ),
    _IDENTITY,
)
INTERLOCKS_GROUP = "interlocks"
"""Name of the group that has one table for each interlock; a run without interlocks has no such group."""
INTERLOCKS = GroupLayout("NXcollection")
INTERLOCK = GroupLayout(
    "NXsensor",
    (Item("value", "float64", "by attribute unit"), ORDER, Item("time_s", "float64", "s")),
    (*_IDENTITY, "unit", "allowed_min", "allowed_max"),
)
CHANNELS_GROUP = "channels"
"""Name of the group that has one table for each channel device; a run without channels has no such group."""
CHANNELS = GroupLayout("NXcollection")
SIGNALS = Item("signals", "S")
"""What a channel device measures, as JSON.

For each signal in the order of its columns: `unit`, `low`, `high`, `delay_s`, `delay_std_s`, `std`, and
`quantity`, which is "load" or "displacement" if the rig file takes it for that of a load frame, and otherwise
empty.
"""
DUE = Item("due_s", "float64", "s")
"""The time at which the images of a step were due on the rig's clock; NaN if no clock asked for them."""
STEP_ITEMS = (
    Item("index", "int64", "1"),
    Item("kind", "S16"),
    Item("target", "float64", "by kind: N, mm or deg"),
    Item("load_n", "float64", "N"),
    Item("displacement_mm", "float64", "mm"),
    Item("angle_deg", "float64", "deg"),
    Item("time_s", "float64", "s"),
)
"""The columns of the table of steps that are the same for all runs, whatever their cameras."""

COMPLETE = Item("complete", "uint8", "1")
LATER: frozenset[Item] = frozenset(
    {
        PROVENANCE,
        CONTINUES,
        SETTINGS,
        DIGEST,
        ORDER,
        DUE,
        *MIDDLE,
        FIXED_FACE,
        DIRECTION,
        *TARGET,
        *MAKING,
        *STAGE_FLAGS,
        *LOAD_FRAME_FLAGS,
    }
)
"""Datasets that files of earlier versions lack."""

EVENTS = GroupLayout(
    "NXcollection",
    (
        Item("level", "S8"),
        Item("source", "S32"),
        Item("message", "S240"),
        ORDER,
        Item("time_s", "float64", "s"),
    ),
)


REPORTED_GROUP = "settings"
"""Name of the table of all settings that the devices reported; files of earlier versions lack this table."""
SETTING_NAME_BYTES = 64
SETTING_BYTES = 240
REPORTED = GroupLayout(
    "NXcollection",
    (
        Item("device", f"S{SETTING_NAME_BYTES}"),
        Item("moment", "S8"),
        Item("name", f"S{SETTING_NAME_BYTES}"),
        Item("value", f"S{SETTING_BYTES}"),
        ORDER,
        Item("time_s", "float64", "s"),
    ),
)


def first_row(camera: str) -> str:
    """Return the name of the column that holds, for each step, the row of a camera's first frame."""
    return f"frames_{camera}"


def row_count(camera: str) -> str:
    """Return the name of the column that holds, for each step, the number of a camera's frames."""
    return f"count_{camera}"


def steps(cameras: Iterable[str]) -> GroupLayout:
    """Return the layout of the table of steps for a run with the given cameras."""
    rows = [Item(name(camera), "int64", "1") for camera in cameras for name in (first_row, row_count)]
    return GroupLayout("NXcollection", (*STEP_ITEMS, *rows, DUE, ORDER, COMPLETE))


def value_of(signal: str) -> str:
    """Return the name of the column that holds the values of a signal, in the signal's unit."""
    return f"value_{signal}"


def is_about_a_gauge(signal: str) -> bool:
    """Return True for a signal about the values of live gauges, such as "gauge.axial.std"."""
    return signal == "gauge_latency" or (signal.startswith("gauge.") and signal.count(".") > 1)


def channels(signals: Iterable[str]) -> GroupLayout:
    """Return the layout of the table of a channel device with the given signals.

    `number` counts the samples of the device, so that a gap shows lost ones. `device_s` is the time on the
    device's own clock, NaN without one. `time_s` is the time of the sample on the rig's clock, without the
    delay of the signal, and `time_std_s` its standard deviation.
    """
    values = [Item(value_of(signal), "float64", "by signals") for signal in signals]
    times = (Item("device_s", "float64", "s"), Item("time_std_s", "float64", "s"))
    return GroupLayout(
        "NXsensor",
        (Item("number", "int64", "1"), *times, *values, ORDER, Item("time_s", "float64", "s")),
        _IDENTITY,
    )
