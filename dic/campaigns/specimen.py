"""The data that the user gives on a specimen of a campaign, and the evaluation of its test."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dic.campaigns.campaign import Campaign, SpecimenTest, campaign_of, require_direction
from dic.derived.gauge_record import gauge_curve, join_record
from dic.derived.gauge_series import measure_gauges
from dic.derived.image_clock import ImageClock
from dic.derived.whole_field import whole_field_gauges
from dic.errors import CurveError, MeasurementError, joined
from dic.files.digest import file_sha256
from dic.gauges.file import read_gauges
from dic.properties.curve import read_curve
from dic.properties.properties import Properties, material_properties
from dic.properties.settings import PropertySettings
from dic.records.machine import read_machine_record


@dataclass(frozen=True)
class Evaluated:
    """The properties of a test, with the kind of strain and the number of images without a reading.

    The kind is empty for a table, whose column of strain the user names. `direction_deg` is the direction
    that a run states, or None.
    """

    properties: Properties
    strain_kind: str = ""
    left_out: int = 0
    direction_deg: float | None = None


@dataclass(frozen=True)
class CurveColumns:
    """The columns of a testing machine's table, named as in the arguments of `read_curve`.

    Attributes
    ----------
    load, strain : str
        Column and unit, such as "Load:kN" and "3:%".
    transverse, time : str or None
    gauge_length_mm : float or None
        Gauge length; needed if the column of strain contains an extension.
    """

    load: str
    strain: str
    transverse: str | None = None
    time: str | None = None
    gauge_length_mm: float | None = None

    def measure(self, file: Path, settings: PropertySettings) -> Evaluated:
        """Return the evaluation of the test whose table is `file`."""
        return Evaluated(material_properties(read_curve(file, **vars(self)), settings))


@dataclass(frozen=True)
class GaugeChoice:
    """The gauges and the load of a result file of `dic correlate` or `dic process`.

    Attributes
    ----------
    gauges : path or None
        TOML file of gauges; None for the whole measured field.
    gauge, transverse_gauge : str or None
        Names of the gauges along and across the specimen. Default: the first gauge along, and no gauge
        across.
    kind, camera : str or None
        As for `gauge_curve`.
    record : path or None
        Table of the testing machine; None if the result file contains the loads.
    load, time, image_column : str or None
        Columns of the record.
    join : str
        "row", "name" or "time", as for `join_record`.
    image_interval_s : float or None
    offset_s, offset_std_s, clock_rate, clock_rate_std_percent
        The machine's clock, as for `ImageClock`.
    """

    gauges: Path | None = None
    gauge: str | None = None
    transverse_gauge: str | None = None
    kind: str | None = None
    camera: str | None = None
    record: Path | None = None
    load: str | None = None
    time: str | None = None
    image_column: str | None = None
    join: str = "row"
    image_interval_s: float | None = None
    offset_s: float | None = 0.0
    offset_std_s: float | None = None
    clock_rate: float | None = 1.0
    clock_rate_std_percent: float | None = None

    def measure(self, file: Path, settings: PropertySettings) -> Evaluated:
        """Return the evaluation of the test whose result file is `file`."""
        # If no gauges are declared, use the two gauges of the whole field; the second lies across the
        # specimen.
        whole = self.gauges is None
        gauges = whole_field_gauges(file) if self.gauges is None else read_gauges(self.gauges)
        gauge = self.gauge or gauges[0].name
        transverse = self.transverse_gauge or (gauges[1].name if whole else None)
        series = measure_gauges(file, gauges, camera=self.camera)
        if self.record is not None:
            if self.load is None:
                remedy = 'give load = "Load:kN"'
                raise CurveError(
                    str(self.record), "load", "the column of the load and its unit", "none", remedy
                )
            record = read_machine_record(self.record, load=self.load, time=self.time, image=self.image_column)
            stds = self.offset_std_s, self.clock_rate_std_percent
            clock = ImageClock(self.image_interval_s, None, self.offset_s, stds[0], self.clock_rate, stds[1])
            series, _ = join_record(series, record, self.join, clock=clock, gauge=gauge)
        read = gauge_curve(series, gauge, transverse, kind=self.kind, camera=self.camera)
        found = read.judged(material_properties(read.curve, settings))
        return Evaluated(
            found, read.kind, read.left_out, None if series.run is None else series.run.direction_deg
        )


@dataclass(frozen=True)
class CampaignSpecimen:
    """A specimen of a campaign.

    Attributes
    ----------
    name : str
    file : path
        Table of a testing machine, or result file of `dic correlate` or `dic process`.
    settings : PropertySettings
        Area and declared uncertainties.
    source : CurveColumns or GaugeChoice
        The columns of the table, or the gauges in the result file.
    direction_deg : float or None
        Angle between the load and the rolling direction, at least 0° and below 180°. Without it, the
        direction is that of the run, if the file is the result of a run that states one.

    Raises
    ------
    CurveError
        If the direction is not possible.
    """

    name: str
    file: Path
    settings: PropertySettings
    source: CurveColumns | GaugeChoice
    direction_deg: float | None = None

    def __post_init__(self) -> None:
        if self.direction_deg is not None:
            require_direction(self.name, self.direction_deg)

    def test(self) -> SpecimenTest:
        """Evaluate the test; an error becomes the test's `failure`."""
        file = Path(self.file)
        about = self.name, str(file)
        try:
            found = self.source.measure(file, self.settings)
            direction_deg = self._direction(found)
            sha256 = file_sha256(file)
        except MeasurementError as failure:
            return SpecimenTest(*about, self.direction_deg, None, failure)
        return SpecimenTest(
            *about,
            direction_deg,
            found.properties,
            sha256=sha256,
            strain_kind=found.strain_kind,
            left_out=found.left_out,
        )

    def _direction(self, found: Evaluated) -> float | None:
        """Return the direction that the user or the run states. Raise `CurveError` if both differ."""
        given, stated = self.direction_deg, found.direction_deg
        if stated is not None:
            require_direction(f"{self.name}, the run", stated)
        if given is not None and stated is not None and given != stated:
            expected, got = f"{stated:g}, which the run states", f"{given:g}"
            remedy = "correct or remove it"
            raise CurveError(self.name, "direction_deg", expected, got, remedy)
        return stated if given is None else given


def measure_campaign(specimens: Sequence[CampaignSpecimen]) -> Campaign:
    """Evaluate the tests of several specimens and compare them.

    `Campaign.failures` lists the tests that failed; the other tests are compared.

    Parameters
    ----------
    specimens : sequence of CampaignSpecimen
        From `read_campaign` or `list_specimens`, or made in Python.

    Raises
    ------
    CurveError
        If two specimens have the same name or file, only some specimens have a direction, or no test could be
        evaluated.
    """
    require_apart(specimens, "campaign")
    tests = [specimen.test() for specimen in specimens]
    if errors := _partly_directed([(test.name, test.direction_deg) for test in tests if test.properties]):
        raise joined(errors)
    return campaign_of(tests)


def require_apart(specimens: Sequence[CampaignSpecimen], source: str) -> None:
    """Raise a `CurveError` if specimens share a name or a file, or only some have a direction.

    The message names all mistakes together.
    """
    errors: list[MeasurementError] = []
    for what, values in (
        ("name", [specimen.name for specimen in specimens]),
        ("file", [str(specimen.file) for specimen in specimens]),
    ):
        expected, remedy = f"a {what} of its own for each specimen", "correct or remove one of them"
        errors += [
            CurveError(source, what, expected, f"{value!r} twice", remedy)
            for value in dict.fromkeys(values)
            if values.count(value) > 1
        ]
    # A result file may state its direction itself, so only those that give one count here.
    known = [(each.name, each.direction_deg) for each in specimens if _states_direction(each)]
    errors += _partly_directed(known, source)
    if errors:
        raise joined(errors)


def _states_direction(specimen: CampaignSpecimen) -> bool:
    return specimen.direction_deg is not None or isinstance(specimen.source, CurveColumns)


def _partly_directed(
    directions_deg: Sequence[tuple[str, float | None]], source: str = "campaign"
) -> list[MeasurementError]:
    """Return an error if only some specimens have a direction."""
    without = [name for name, direction_deg in directions_deg if direction_deg is None]
    if not 0 < len(without) < len(directions_deg):
        return []
    expected, got = "a direction of each specimen, or none", f"none of {', '.join(without)}"
    return [CurveError(source, "direction_deg", expected, got, "name all directions, or none")]
