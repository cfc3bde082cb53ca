"""Facts about a test that only the user knows: laboratory, specimen, machine, pattern, cameras, lenses."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from dic.errors import MeasurementError, RunFileError, joined
from dic.files.toml import NUMBER, TEXT, is_of_kind, read_toml, wrong_values
from dic.typing import PathLike

NOT_STATED = "not stated"
"""Text in the report for a fact that is neither measured nor stated by the user."""

_ABSOLUTE_ZERO_C = -273.15


@dataclass(frozen=True)
class Fact:
    """A fact that the user can state.

    Attributes
    ----------
    name : str
        Name in the report.
    kind : str
        Kind of the value, such as `TEXT`.
    unit : str
    above : float
        A number must be above this value. Sizes, distances, rates and times are positive.
    """

    name: str
    kind: str = TEXT
    unit: str = ""
    above: float = 0.0

    def text(self, value: Any) -> str:
        """Return a value of this fact as text, with its unit."""
        number = value if isinstance(value, str) else f"{value:g}"
        return f"{number} {self.unit}".rstrip()

    def is_possible(self, value: object) -> bool:
        """Return False for a number that is not above the fact's limit."""
        return self.kind != NUMBER or not is_of_kind(value, NUMBER) or value > self.above  # type: ignore[operator]


FACTS: Mapping[str, Mapping[str, Fact]] = {
    "laboratory": {
        "name": Fact("Name"),
        "operator": Fact("Operator"),
        "report_number": Fact("Number of the report"),
        "order": Fact("Order"),
        "date": Fact("Date of the test"),
    },
    "specimen": {
        "name": Fact("Name"),
        "material": Fact("Material"),
        "condition": Fact("Condition"),
        "orientation": Fact("Direction of the specimen in the product"),
        "shape": Fact("Shape and standard of the specimen"),
        "width_mm": Fact("Width", NUMBER, "mm"),
        "thickness_mm": Fact("Thickness", NUMBER, "mm"),
        "parallel_length_mm": Fact("Parallel length", NUMBER, "mm"),
        "gauge_length_mm": Fact("Gauge length", NUMBER, "mm"),
        "preparation": Fact("Preparation"),
    },
    "machine": {
        "model": Fact("Model"),
        "load_cell": Fact("Load cell"),
        "load_cell_class": Fact("Class of the load cell (ISO 7500-1)"),
        "grips": Fact("Grips"),
        "control": Fact("Control and rate of the test"),
        "temperature_c": Fact("Temperature", NUMBER, "°C", above=_ABSOLUTE_ZERO_C),
    },
    "pattern": {
        "technique": Fact("Patterning technique"),
        "feature_size_mm": Fact("Feature size as made", NUMBER, "mm"),
    },
    "cameras": {
        "model": Fact("Camera"),
        "lens": Fact("Lens"),
        "focal_length_mm": Fact("Focal length", NUMBER, "mm"),
        "aperture": Fact("Aperture"),
        "stand_off_mm": Fact("Stand-off distance", NUMBER, "mm"),
        "frame_rate_hz": Fact("Image acquisition rate", NUMBER, "Hz"),
        "exposure_ms": Fact("Exposure time", NUMBER, "ms"),
        "lighting": Fact("Lighting"),
    },
}
"""All facts, keyed by table and key in the file. A fact of `cameras` may also be in the table of a single
camera.
"""
_CAMERAS = "cameras"
_EXAMPLE = 'write [specimen], material = "2024-T3"; docs/report.md has an example'


@dataclass(frozen=True)
class StatedFacts:
    """The facts that the user states about a test.

    Attributes
    ----------
    tables : mapping of str to mapping
        Values, keyed by table and key as in the file. The table `cameras` has the facts common to all
        cameras.
    cameras : mapping of str to mapping
        Facts about single cameras, keyed by the camera's name.
    """

    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    cameras: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def given(self, table: str, key: str, camera: str = "") -> str | None:
        """Return a fact as text with its unit; None if the user did not state it."""
        own = self.cameras.get(camera, {}) if table == _CAMERAS else {}
        value = own.get(key, self.tables.get(table, {}).get(key))
        return None if value is None else FACTS[table][key].text(value)

    def stated(self, table: str, key: str, camera: str = "") -> str:
        """Return a fact as text with its unit, or "not stated"."""
        return self.given(table, key, camera) or NOT_STATED

    def require_cameras(self, names: Iterable[str]) -> None:
        """Raise an error if the user states facts about a camera that the results do not have.

        Raises
        ------
        RunFileError
        """
        known = [name for name in names if name]
        unknown = [name for name in self.cameras if name not in known]
        if unknown:
            expected = (
                f"one of {', '.join(known)}" if known else "[cameras], for results without named cameras"
            )
            remedy = "correct the name of the table"
            raise RunFileError("stated facts", "cameras", expected, f"[cameras.{unknown[0]}]", remedy)

    def as_dict(self) -> dict[str, Any]:
        """Return all stated facts as a dict for JSON."""
        found: dict[str, Any] = {name: dict(table) for name, table in self.tables.items()}
        if self.cameras:
            found[_CAMERAS] = found.get(_CAMERAS, {}) | {
                name: dict(own) for name, own in self.cameras.items()
            }
        return found


def read_stated_facts(path: PathLike) -> StatedFacts:
    """Read the facts that the user states about a test from a TOML file.

    The file has the tables [laboratory], [specimen], [machine], [pattern] and [cameras], and a table
    [cameras.NAME] for facts of one camera. All tables and keys are optional. `docs/report.md` describes them.

    Parameters
    ----------
    path : path

    Raises
    ------
    RunFileError
        If the file cannot be read, or there are unknown keys, values of a wrong type or impossible numbers,
        such as a negative width. The message names all mistakes together.
    """
    content = read_toml(path, RunFileError, "read the stated facts", _EXAMPLE)
    errors: list[MeasurementError] = []
    tables: dict[str, Mapping[str, Any]] = {}
    cameras: dict[str, Mapping[str, Any]] = {}
    for name, table in content.items():
        if name not in FACTS or not isinstance(table, dict):
            expected = f"tables {', '.join(f'[{known}]' for known in FACTS)}"
            errors.append(RunFileError(str(path), "top of the file", expected, repr(name)[:80], _EXAMPLE))
            continue
        if name == _CAMERAS:
            cameras = {key: value for key, value in table.items() if isinstance(value, dict)}
            table = {key: value for key, value in table.items() if key not in cameras}
        tables[name] = table
    for name, table in tables.items():
        errors += _mistakes(f"{path}, [{name}]", table, FACTS[name])
    for camera, table in cameras.items():
        errors += _mistakes(f"{path}, [{_CAMERAS}.{camera}]", table, FACTS[_CAMERAS])
    if errors:
        raise joined(errors)
    return StatedFacts(tables, cameras)


def _mistakes(place: str, table: Mapping[str, Any], facts: Mapping[str, Fact]) -> Iterator[MeasurementError]:
    """Yield an error for each unknown key, value of a wrong type and impossible number of a table."""
    yield from wrong_values(place, table, {key: fact.kind for key, fact in facts.items()}, RunFileError)
    for key, value in table.items():
        if key in facts and not facts[key].is_possible(value):
            expected = f"a number above {facts[key].above:g}"
            yield RunFileError(place, key, expected, repr(value)[:80], "correct the value")
