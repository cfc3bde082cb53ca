"""Facts about a test that only the user knows: laboratory, specimen, machine, pattern, cameras, lenses."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from typing import Any

from dic.errors import MeasurementError, RunFileError, joined
from dic.files.toml import DATE, NUMBER, TEXT, is_of_kind, read_toml, wrong_values
from dic.report.fact_table import Fact
from dic.typing import PathLike

_ABSOLUTE_ZERO_C = -273.15


@dataclass(frozen=True)
class FactKind:
    """A kind of fact that the user can state."""

    name: str
    """Name in the report."""
    kind: str = TEXT
    """Kind of the value, such as `TEXT`."""
    unit: str = ""
    above: float = 0.0
    """A number must be above this value. Sizes, distances, rates and times are positive."""

    def text(self, value: Any) -> str:
        """Return a value of this fact as text, with its unit."""
        number = value if isinstance(value, str) else f"{value:g}"
        return f"{number} {self.unit}".rstrip()

    def is_possible(self, value: object) -> bool:
        """Return False for a number that is not above the fact's limit."""
        return self.kind != NUMBER or not is_of_kind(value, NUMBER) or value > self.above  # type: ignore[operator]


FACTS: Mapping[str, Mapping[str, FactKind]] = {
    "laboratory": {
        "name": FactKind("Name"),
        "operator": FactKind("Operator"),
        "report_number": FactKind("Number of the report"),
        "order": FactKind("Order"),
        "date": FactKind("Date of the test", DATE),
    },
    "specimen": {
        "name": FactKind("Name"),
        "material": FactKind("Material"),
        "condition": FactKind("Condition"),
        "orientation": FactKind("Direction of the specimen in the product"),
        "shape": FactKind("Shape and standard of the specimen"),
        "width_mm": FactKind("Width", NUMBER, "mm"),
        "thickness_mm": FactKind("Thickness", NUMBER, "mm"),
        "parallel_length_mm": FactKind("Parallel length", NUMBER, "mm"),
        "gauge_length_mm": FactKind("Gauge length", NUMBER, "mm"),
        "preparation": FactKind("Preparation"),
    },
    "machine": {
        "model": FactKind("Model"),
        "load_cell": FactKind("Load cell"),
        "load_cell_class": FactKind("Class of the load cell (ISO 7500-1)"),
        "grips": FactKind("Grips"),
        "control": FactKind("Control and rate of the test"),
        "temperature_c": FactKind("Temperature", NUMBER, "°C", above=_ABSOLUTE_ZERO_C),
    },
    "pattern": {
        "technique": FactKind("Patterning technique"),
        "feature_size_mm": FactKind("Feature size as made", NUMBER, "mm"),
    },
    "cameras": {
        "model": FactKind("Camera"),
        "lens": FactKind("Lens"),
        "focal_length_mm": FactKind("Focal length", NUMBER, "mm"),
        "aperture": FactKind("Aperture"),
        "stand_off_mm": FactKind("Stand-off distance", NUMBER, "mm"),
        "frame_rate_hz": FactKind("Image acquisition rate", NUMBER, "Hz"),
        "exposure_ms": FactKind("Exposure time", NUMBER, "ms"),
        "lighting": FactKind("Lighting"),
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
    source : str
        The file of the facts; "" for facts that were given in Python.
    """

    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    cameras: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    source: str = ""

    def given(self, table: str, key: str, camera: str = "") -> str | None:
        """Return a fact as text with its unit; None if the user did not state it."""
        own = self.cameras.get(camera, {}) if table == _CAMERAS else {}
        value = own.get(key, self.tables.get(table, {}).get(key))
        return None if value is None else FACTS[table][key].text(value)

    def stated(self, table: str, key: str, camera: str = "", known: Fact | None = None) -> Fact:
        """Return a fact that the user states, with its place in the file; else the known fact.

        Parameters
        ----------
        table, key : str
        camera : str
            The camera, for facts of the table "cameras".
        known : Fact, optional
            The fact from the results. Default: a fact that is not stated.
        """
        text = self.given(table, key, camera)
        if text is None:
            return known or Fact()
        own = table == _CAMERAS and key in self.cameras.get(camera, {})
        return Fact(text, self.source, f"[{table}.{camera}]" if own else f"[{table}]", f"stated as {key}")

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
    return StatedFacts({name: _plain(table) for name, table in tables.items()}, cameras, str(path))


def _mistakes(
    place: str, table: Mapping[str, Any], facts: Mapping[str, FactKind]
) -> Iterator[MeasurementError]:
    """Yield an error for each unknown key, value of a wrong type and impossible number of a table."""
    yield from wrong_values(place, table, {key: fact.kind for key, fact in facts.items()}, RunFileError)
    for key, value in table.items():
        if key in facts and not facts[key].is_possible(value):
            expected = f"a number above {facts[key].above:g}"
            yield RunFileError(place, key, expected, repr(value)[:80], "correct the value")


def _plain(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with dates of TOML as texts of ISO 8601, so that JSON can contain them."""
    return {key: value.isoformat() if isinstance(value, date) else value for key, value in table.items()}
