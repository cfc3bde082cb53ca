"""A campaign: the properties of several specimens, compared."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from dic.campaigns.scatter import Scatter, scatter_of
from dic.errors import CurveError, MeasurementError, is_number, require_kind
from dic.properties.anisotropy import DIRECTIONS_DEG, planar_anisotropy
from dic.properties.properties import Properties
from dic.properties.value import PropertyValue

COMPARE_FIRST = "compare specimens first: dic.campaigns.compare_specimens(properties)"
"""Remedy if a function that needs a campaign gets something else."""
MOST_TOLD = 5
"""If no test could be evaluated, the error gives the reasons of at most this number of tests."""


@dataclass(frozen=True)
class SpecimenTest:
    """The tensile test of one specimen, with its properties or the reason why there are none.

    Attributes
    ----------
    name : str
    file : str
        The record or result file; empty if the properties were given.
    direction_deg : float or None
        Angle between the load and the rolling direction; None if it was not given.
    properties : Properties or None
        The properties; None if the test could not be evaluated.
    failure : MeasurementError or None
        The reason why the test could not be evaluated; None if it was evaluated.
    sha256 : str
        SHA-256 of the file; empty if the properties were given.
    strain_kind : str
        Kind of strain of a result file: "raw", "calibrated" or "corrected"; empty for a table and if the
        properties were given.
    left_out : int
        Number of images of a result file without a reading.
    """

    name: str
    file: str
    direction_deg: float | None
    properties: Properties | None
    failure: MeasurementError | None = None
    sha256: str = ""
    strain_kind: str = ""
    left_out: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Return the test as a dict for JSON."""
        about = {"name": self.name, "file": self.file or None, "direction_deg": self.direction_deg}
        if self.properties is None:
            return about | {"failure": str(self.failure)}
        about |= {"sha256": self.sha256 or None, "failure": None}
        if self.strain_kind:
            about |= {"strain_kind": self.strain_kind, "left_out": self.left_out}
        return about | self.properties.as_dict()


@dataclass(frozen=True)
class Group:
    """Specimens whose properties are compared: all specimens, or those with the same direction."""

    direction_deg: float | None
    """Direction of the specimens; None for the group of all specimens."""
    scatter: dict[str, Scatter]
    """Mean and scatter of each property, keyed by the property's key, such as "E_gpa"."""
    names: tuple[str, ...]
    """Names of the specimens in the group."""

    @property
    def label(self) -> str:
        """Name of the group for tables: its direction, or all specimens."""
        return "all specimens" if self.direction_deg is None else f"{self.direction_deg:g}°"

    def as_dict(self) -> dict[str, Any]:
        """Return the group as a dict for JSON."""
        return {
            "direction_deg": self.direction_deg,
            "specimens": list(self.names),
            "quantities": {name: scatter.as_dict() for name, scatter in self.scatter.items()},
        }


@dataclass(frozen=True)
class Campaign:
    """The tests of several specimens.

    Attributes
    ----------
    tests : tuple of SpecimenTest
        The tests in the order in which they were given. At least one test could be evaluated.
    """

    tests: tuple[SpecimenTest, ...]

    @property
    def failures(self) -> list[SpecimenTest]:
        """The tests that could not be evaluated."""
        return [test for test in self.tests if test.properties is None]

    @cached_property
    def found(self) -> dict[str, Properties]:
        """The properties of the tests that did not fail, keyed by the name of the specimen."""
        return {test.name: test.properties for test in self.tests if test.properties is not None}

    @cached_property
    def quantities(self) -> list[str]:
        """Keys of the properties that at least one specimen has."""
        keys = dict.fromkeys(name for found in self.found.values() for name in found.values)
        return [key for key in keys if any(self._has(found, key) for found in self.found.values())]

    @property
    def kinds(self) -> dict[str, list[str]]:
        """Names of the evaluated specimens with result files, keyed by their kind of strain."""
        found: dict[str, list[str]] = {}
        for test in self.tests:
            if test.strain_kind:
                found.setdefault(test.strain_kind, []).append(test.name)
        return found

    @property
    def warnings(self) -> list[str]:
        """One sentence if the specimens have different kinds of strain, whose errors differ."""
        if len(self.kinds) < 2:
            return []
        told = "; ".join(f"{kind}: {', '.join(names)}" for kind, names in self.kinds.items())
        return [f"The specimens have different kinds of strain ({told}); give all the same kind."]

    @property
    def lacking(self) -> list[str]:
        """Keys of the properties that no specimen has."""
        keys = dict.fromkeys(name for found in self.found.values() for name in found.values)
        return [key for key in keys if key not in self.quantities]

    def example(self, key: str) -> PropertyValue:
        """Return one value of the property `key`, from which its unit and rule can be read."""
        return next(found.values[key] for found in self.found.values() if self._has(found, key))

    @staticmethod
    def _has(found: Properties, key: str) -> bool:
        return key in found.values and found.values[key].value is not None

    @cached_property
    def directions_deg(self) -> list[float]:
        """The directions of the evaluated specimens, in order."""
        known = {test.direction_deg for test in self.tests if test.name in self.found}
        return sorted(each for each in known if each is not None)

    @cached_property
    def groups(self) -> list[Group]:
        """The group of all specimens, and a group for each direction that has two or more, but not all."""
        whole = self._group(None)
        apart = [self._group(direction) for direction in self.directions_deg]
        return [whole, *(group for group in apart if 1 < len(group.names) < len(whole.names))]

    def _group(self, direction_deg: float | None) -> Group:
        names = tuple(
            test.name
            for test in self.tests
            if test.name in self.found and direction_deg in (None, test.direction_deg)
        )
        scatter = {}
        for key in self.quantities:
            values = {n: self.found[n].values[key] for n in names if key in self.found[n].values}
            if values:
                scatter[key] = scatter_of(values)
        return Group(direction_deg, scatter, names)

    def outliers_of(self, name: str) -> list[tuple[str, Group]]:
        """Return the keys of the properties in which a specimen is an outlier, each with the group."""
        return [
            (key, group)
            for group in self.groups
            for key, scatter in group.scatter.items()
            if scatter.outlying == name
        ]

    @cached_property
    def anisotropy(self) -> dict[str, PropertyValue]:
        """r̄ and Δr from the mean strain ratio of each direction; {} if no directions were given.

        The standard deviation of a direction's mean ratio is the larger one of two values: one computed from
        the scatter, and one computed from the stated standard deviations.
        """
        if not self.directions_deg:
            return {}
        named = [test for test in self.tests if test.name in self.found]
        ratios = {}
        for direction in DIRECTIONS_DEG:
            own = {
                test.name: self.found[test.name].values["r"]
                for test in named
                if test.direction_deg == direction
            }
            ratios[direction] = _mean_ratio(own)
        return planar_anisotropy(ratios)

    @property
    def not_counted(self) -> list[str]:
        """Names of the uncertainties that are not declared for at least one specimen."""
        return list(dict.fromkeys(name for found in self.found.values() for name in found.not_counted))

    def as_dict(self) -> dict[str, Any]:
        """Return the whole campaign as a dict for JSON."""
        return {
            "specimens": [test.as_dict() for test in self.tests],
            "groups": [group.as_dict() for group in self.groups],
            "anisotropy": {name: value.as_dict() for name, value in self.anisotropy.items()} or None,
            "not_counted": self.not_counted,
            "warnings": self.warnings,
        }


def compare_specimens(
    properties: Mapping[str, Properties], directions_deg: Mapping[str, float] | None = None
) -> Campaign:
    """Compare the material properties of several specimens: mean, scatter, outliers, r̄ and Δr.

    Parameters
    ----------
    properties : mapping of str to Properties
        Results of `material_properties`, keyed by the name of the specimen.
    directions_deg : mapping of str to float, optional
        Angle between the load and the rolling direction for each specimen.

    Returns
    -------
    Campaign

    Raises
    ------
    CurveError
        If there is no specimen, or directions are missing or impossible.
    """
    for found in properties.values():
        require_kind("properties", found, Properties, "compute them with dic.material_properties")
    directions = dict(directions_deg or {})
    if directions and set(directions) != set(properties):
        expected, remedy = "a direction of each specimen, or none", "name the directions of all specimens"
        odd = ", ".join(sorted(set(directions) ^ set(properties)))
        raise CurveError("campaign", "directions", expected, f"a difference at {odd}", remedy)
    for name, direction in directions.items():
        require_direction(name, direction)
    tests = [SpecimenTest(name, "", directions.get(name), found) for name, found in properties.items()]
    return campaign_of(tests)


def campaign_of(tests: list[SpecimenTest]) -> Campaign:
    """Return the campaign that consists of the given tests.

    Raises `CurveError` if no test could be evaluated.
    """
    campaign = Campaign(tuple(tests))
    if not campaign.found:
        told = [str(test.failure) for test in tests]
        more = f"; and {len(told) - MOST_TOLD} more" if len(told) > MOST_TOLD else ""
        got = f"{len(tests)} that failed: {'; '.join(told[:MOST_TOLD])}{more}"
        remedy = "correct the files or their description"
        raise CurveError("campaign", "evaluate", "at least one specimen", got if tests else "none", remedy)
    return campaign


def require_direction(source: str, direction_deg: object) -> None:
    """Raise a `CurveError` if a value is no direction from 0° up to 180°."""
    if not (is_number(direction_deg) and 0.0 <= direction_deg < 180.0):  # type: ignore[operator]
        expected, remedy = "at least 0° and below 180°", "give direction_deg = 45"
        raise CurveError(source, "direction_deg", expected, repr(direction_deg), remedy)


def _mean_ratio(ratios: Mapping[str, PropertyValue]) -> PropertyValue:
    """Return the mean strain ratio of the specimens of a direction; its value is None without specimens."""
    if not ratios:
        return PropertyValue(
            None, None, "1", "mean of the specimens", flags=("no specimen in this direction",)
        )
    scatter = scatter_of(ratios)
    flags = [f"{name}: {flag}" for name, ratio in ratios.items() for flag in ratio.flags]
    value = next(iter(ratios.values()))
    return replace(value, value=scatter.mean, std=scatter.std_of_mean, window={}, flags=tuple(flags))
