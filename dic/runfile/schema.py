"""The layout of a run file: all names, types, units and sizes (their meaning: docs/run-file.md)."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

FORMAT = "offaxis-run"
VERSION = 1

RunStatus: TypeAlias = Literal["running", "completed", "aborted", "failed"]
Level: TypeAlias = Literal["info", "warning", "error"]
StepKind: TypeAlias = Literal["grid", "reference", "load", "displacement", "rotation"]

ROOT_ATTRIBUTES = {"default": "entry", "file_format": FORMAT, "file_format_version": VERSION}


@dataclass(frozen=True)
class Item:
    """A dataset.

    Attributes
    ----------
    name : str
    dtype : str
        NumPy's name of a number type; for a text "S" and its number of bytes, or "S" alone if the length is
        variable.
    units : str
        Unit of a number; "1" for a number without a unit.
    """

    name: str
    dtype: str
    units: str = ""

    @property
    def text_bytes(self) -> int | None:
        """The largest number of bytes of a text, 0 if not limited; None for a number."""
        return int(self.dtype[1:] or 0) if self.dtype.startswith("S") else None


@dataclass(frozen=True)
class Group:
    """A group: its NeXus class, its other attributes, and its datasets in the order of writing."""

    nx_class: str
    items: tuple[Item, ...] = ()
    attributes: tuple[str, ...] = ()


_IDENTITY = ("vendor", "model", "serial", "firmware")

ENTRY = Group(
    "NXentry",
    (
        Item("title", "S"),
        Item("run_id", "S"),
        Item("definition", "S"),
        Item("configuration", "S"),
        Item("start_time", "S"),
        Item("versions", "S"),
        Item("end_time", "S40"),
        Item("status", "S16"),
        Item("status_reason", "S480"),
    ),
    ("simulated",),
)
SAMPLE = Group(
    "NXsample",
    (
        Item("name", "S"),
        Item("thickness_mm", "float64", "mm"),
        Item("width_mm", "float64", "mm"),
        Item("gauge_length_mm", "float64", "mm"),
    ),
)
GRID = Group("NXcollection", (Item("lines", "int64", "1"), Item("pitch_mm", "float64", "mm")))
INSTRUMENT = Group("NXinstrument")

# The groups below are tables: their items are columns of one length, and the last column is written last.

PIXELS = "data"
"""Name of a camera's images, (n, height, width) uint8 or uint16, beside the columns of `DETECTOR`."""

PIXELS_ATTRIBUTES = {"units": "1", "interpretation": "image"}

DETECTOR = Group(
    "NXdetector",
    (
        Item("exposed_s", "float64", "s"),
        Item("received_s", "float64", "s"),
        Item("utc_ns", "int64", "ns"),
        Item("sequence", "int64", "1"),
        Item("flags", "int64", "1"),
        Item("exposure_us", "float64", "us"),
        Item("gain", "float64", "1"),
        Item("step", "int64", "1"),
        Item("valid", "uint8", "1"),
    ),
    (*_IDENTITY, "bits"),
)
STAGE = Group(
    "NXpositioner", (Item("angle_deg", "float64", "deg"), Item("time_s", "float64", "s")), _IDENTITY
)
LOAD_FRAME = Group(
    "NXsensor",
    (
        Item("load_n", "float64", "N"),
        Item("displacement_mm", "float64", "mm"),
        Item("time_s", "float64", "s"),
    ),
    _IDENTITY,
)
STEP_ITEMS = (
    Item("index", "int64", "1"),
    Item("kind", "S16"),
    Item("target", "float64", "by kind: N, mm or deg"),
    Item("load_n", "float64", "N"),
    Item("displacement_mm", "float64", "mm"),
    Item("angle_deg", "float64", "deg"),
    Item("time_s", "float64", "s"),
)
"""Columns of the table of steps that do not depend on the cameras."""

COMPLETE = Item("complete", "uint8", "1")
EVENTS = Group(
    "NXcollection",
    (Item("level", "S8"), Item("source", "S32"), Item("message", "S240"), Item("time_s", "float64", "s")),
)


def first_row(camera: str) -> str:
    """Return the name of the steps' column that holds the first row of a camera's frames."""
    return f"frames_{camera}"


def row_count(camera: str) -> str:
    """Return the name of the steps' column that holds the number of a camera's frames."""
    return f"count_{camera}"


def steps(cameras: Iterable[str]) -> Group:
    """Return the table of steps of a run with these cameras."""
    rows = [Item(name(camera), "int64", "1") for camera in cameras for name in (first_row, row_count)]
    return Group("NXcollection", (*STEP_ITEMS, *rows, COMPLETE))
