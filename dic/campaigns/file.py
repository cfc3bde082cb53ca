"""Find the specimens of a campaign: in a strict TOML file, or as tables with equal columns in a folder."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any, TypeVar

from dic.campaigns.specimen import CampaignSpecimen, CurveColumns, GaugeChoice, require_apart
from dic.derived.gauge_series import is_results
from dic.errors import CurveError, MeasurementError, joined
from dic.files.toml import NUMBER, NUMBERS, TEXT, is_of_kind, read_toml, wrong_values
from dic.image.pages import natural_key
from dic.properties.settings import PropertySettings
from dic.typing import PathLike

FILE_NAME = "campaign.toml"
_EXAMPLE = 'write [[specimen]], file = "a.csv", area_mm2, load and strain; docs/campaigns.md has an example'
_AREA = {"area_mm2": NUMBER, "area_std_mm2": NUMBER}
_SIDES = {"width_mm": NUMBER, "thickness_mm": NUMBER, "width_std_mm": NUMBER, "thickness_std_mm": NUMBER}
_COMMON = {
    **_AREA,
    **_SIDES,
    "direction_deg": NUMBER,
    "load_std_percent": NUMBER,
    "strain_std_percent": NUMBER,
    "offsets_percent": NUMBERS,
    "window_mpa": NUMBERS,
    "hardening_percent": NUMBERS,
    "load": TEXT,
    "time": TEXT,
}
_OF_TABLES = {"strain": TEXT, "transverse": TEXT, "gauge_length_mm": NUMBER}
_OF_RESULTS = {
    **dict.fromkeys(("gauges", "gauge", "transverse_gauge", "kind", "camera"), TEXT),
    **dict.fromkeys(("record", "join", "image_column"), TEXT),
    **dict.fromkeys(("image_interval_s", "offset_s", "offset_std_s"), NUMBER),
    **dict.fromkeys(("clock_rate", "clock_rate_std_percent"), NUMBER),
}
_OWN = {"name": TEXT, "file": TEXT}
_PATHS = ("gauges", "record")
_ENDINGS = (".h5", ".hdf5")
Part = TypeVar("Part")


def read_campaign(folder: PathLike) -> tuple[CampaignSpecimen, ...]:
    """Read the specimens that the file campaign.toml of a folder describes.

    The file has a table ``[[specimen]]`` for each specimen, and a table ``[defaults]`` with keys that apply
    to all specimens. Files are named relative to the folder. `docs/campaigns.md` describes all keys.

    Parameters
    ----------
    folder : path
        The folder, or the TOML file itself.

    Raises
    ------
    CurveError
        If the file cannot be read, or there are unknown keys or impossible values. The message names all
        mistakes together.
    """
    path = Path(folder)
    path = path if path.suffix.lower() == ".toml" else path / FILE_NAME
    defaults, tables, errors = _content(path)
    errors += wrong_values(f"{path}, [defaults]", defaults, _COMMON | _OF_TABLES | _OF_RESULTS, CurveError)
    places = [_place(path, number, table) for number, table in enumerate(tables, 1)]
    files = []
    for place, table in zip(places, tables, strict=True):
        found, wrong = _caught(_file, place, path.parent, table)
        errors += wrong
        if found is not None:
            files.append(found)
            errors += wrong_values(place, table, _OWN | found.keys, CurveError, found.kind)
    errors += _idle(f"{path}, [defaults]", defaults, files)
    if errors:
        raise joined(errors)
    specimens = []
    for place, table, file in zip(places, tables, files, strict=True):
        specimen, wrong = _caught(_specimen, place, file, table, defaults)
        errors += wrong
        specimens += [] if specimen is None else [specimen]
    if not errors:
        errors += _caught(require_apart, specimens, str(path))[1]
    if errors:
        raise joined(errors)
    return tuple(specimens)


def list_specimens(
    folder: PathLike,
    columns: CurveColumns,
    settings: PropertySettings,
    *,
    pattern: str = "*.csv",
    leave_out: Collection[PathLike] = (),
) -> tuple[CampaignSpecimen, ...]:
    """Return a specimen for each table in a folder; all tables have the same columns and settings.

    Parameters
    ----------
    folder : path
    columns : CurveColumns
    settings : PropertySettings
    pattern : str
        Pattern of the names of the tables. Each specimen is named after its file.
    leave_out : collection of path
        Files that match the pattern but are not tables of specimens.

    Raises
    ------
    CurveError
        If no file matches the pattern.
    """
    place, out = Path(folder), {Path(path).resolve() for path in leave_out}
    try:
        files = sorted((path for path in place.glob(pattern) if path.is_file()), key=natural_key)
    except (ValueError, NotImplementedError) as error:
        # pathlib raises a ValueError for an empty pattern, and a NotImplementedError for an absolute pattern.
        expected, remedy = "a pattern of files in the folder", 'give --files "*.csv"'
        raise CurveError(str(folder), "--files", expected, repr(pattern), remedy) from error
    except OSError as error:
        expected, remedy = "a folder that can be read", "name another folder"
        got = error.strerror or str(error)
        raise CurveError(str(folder), "list specimens", expected, got, remedy) from error
    files = [path for path in files if path.resolve() not in out]
    if not files:
        expected, remedy = f"a folder with files {pattern}", f"name another folder, or write {FILE_NAME}"
        got = "none" if place.is_dir() else "no folder"
        raise CurveError(str(folder), "list specimens", expected, got, remedy)
    return tuple(CampaignSpecimen(path.stem, path, settings, columns) for path in files)


def _content(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]], list[MeasurementError]]:
    """Return the defaults, the tables of the specimens, and the mistakes in the file's top-level keys."""
    source = str(path)
    content = read_toml(path, CurveError, "read the campaign", _EXAMPLE)
    defaults, tables = content.pop("defaults", {}), content.pop("specimen", None)
    errors: list[MeasurementError] = [
        CurveError(
            source, "top of the file", "[defaults] and [[specimen]]", repr(key)[:80], "remove this key"
        )
        for key in content
    ]
    if not isinstance(defaults, dict):
        errors.append(CurveError(source, "defaults", "a table [defaults]", "another value", _EXAMPLE))
    if not isinstance(tables, list) or not tables or not all(isinstance(one, dict) for one in tables):
        expected = "a table [[specimen]] for each specimen"
        raise joined([*errors, CurveError(source, "read the campaign", expected, "none", _EXAMPLE)])
    return defaults if isinstance(defaults, dict) else {}, tables, errors


@dataclass(frozen=True)
class _File:
    """The file of a specimen, and the keys that a specimen with such a file may have."""

    folder: Path
    name: str
    from_results: bool

    @property
    def path(self) -> Path:
        return self.folder / self.name

    @property
    def keys(self) -> dict[str, str]:
        return _COMMON | (_OF_RESULTS if self.from_results else _OF_TABLES)

    @property
    def kind(self) -> str:
        return "a result file" if self.from_results else "a table"


def _place(path: Path, number: int, table: Mapping[str, Any]) -> str:
    name = table.get("name", table.get("file"))
    return f"{path}, specimen {name[:60]!r}" if isinstance(name, str) else f"{path}, specimen {number}"


def _file(place: str, folder: Path, table: Mapping[str, Any]) -> _File:
    name = table.get("file")
    if not is_of_kind(name, TEXT):
        got = "none" if name is None else repr(name)[:80]
        raise CurveError(place, "file", "the name of a file", got, 'give file = "a.csv"')
    path = folder / str(name)
    found, _ = _caught(is_results, path)
    # If a file cannot be read, only its evaluation fails later, and the other specimens are still compared.
    return _File(folder, str(name), path.suffix.lower() in _ENDINGS if found is None else found)


def _idle(place: str, defaults: Mapping[str, Any], files: Sequence[_File]) -> Iterator[MeasurementError]:
    """Yield an error for each known key of the defaults that has no effect on any specimen."""
    for key in defaults:
        if key in _COMMON | _OF_TABLES | _OF_RESULTS and not any(key in file.keys for file in files):
            expected = "keys that the file of a specimen can use"
            yield CurveError(place, "keys", expected, key, "remove this key")


def _specimen(
    place: str, file: _File, table: Mapping[str, Any], defaults: Mapping[str, Any]
) -> CampaignSpecimen:
    """Return a specimen from its own table; a key that its table lacks has the value from the defaults."""
    # If a specimen gives its area, ignore width and thickness in the defaults, and the reverse.
    replaced = _SIDES if set(table) & set(_AREA) else _AREA if set(table) & set(_SIDES) else {}
    inherited = {key: value for key, value in defaults.items() if key in file.keys and key not in replaced}
    values = {**inherited, **table}
    settings, wrong = _caught(_settings, place, values)
    source, wrong_source = _caught(_source, place, file, values)
    if settings is None or source is None:
        raise joined([*wrong, *wrong_source])
    named = values.get("name", file.path.stem)
    try:
        return CampaignSpecimen(named, file.path, settings, source, values.get("direction_deg"))
    except MeasurementError as error:
        raise error.at(place) from error


def _settings(place: str, values: Mapping[str, Any]) -> PropertySettings:
    keys = ("load_std_percent", "strain_std_percent")
    lists = ("offsets_percent", "window_mpa", "hardening_percent")
    given = {key: values[key] for key in keys if key in values}
    given |= {key: tuple(values[key]) for key in lists if key in values}
    if "offsets_percent" in given:
        given["offsets_percent"] = tuple(dict.fromkeys((0.2, *given["offsets_percent"])))
    area_mm2, area_std_mm2 = _area(place, values)
    try:
        return PropertySettings(area_mm2=area_mm2, area_std_mm2=area_std_mm2, **given)
    except MeasurementError as error:
        raise error.at(place) from error


def _area(place: str, values: Mapping[str, Any]) -> tuple[float, float | None]:
    """Return a specimen's area and its standard deviation, given directly or as width and thickness."""
    sides = [key for key in _SIDES if key in values]
    remedy = "give area_mm2 = 120.0, or width_mm and thickness_mm"
    if "area_mm2" in values:
        if sides:
            raise CurveError(place, "area", "area_mm2, or the sides", f"area_mm2 and {sides[0]}", remedy)
        return values["area_mm2"], values.get("area_std_mm2")
    if "width_mm" not in values or "thickness_mm" not in values or "area_std_mm2" in values:
        got = ", ".join(key for key in values if key in _AREA | _SIDES) or "none"
        raise CurveError(place, "area", "area_mm2, or width_mm and thickness_mm", got, remedy)
    width, thickness = values["width_mm"], values["thickness_mm"]
    stds = values.get("width_std_mm"), values.get("thickness_std_mm")
    numbers = (width, thickness, *(std for std in stds if std is not None))
    if not (0.0 < width < 1e4 and 0.0 < thickness < 1e4 and all(number >= 0.0 for number in numbers)):
        got = ", ".join(f"{key} = {values[key]!r}" for key in sides)
        raise CurveError(place, "area", "width and thickness above 0 mm", got, "correct the sides")
    if stds == (None, None):
        return width * thickness, None
    if None in stds:
        expected, got = "width_std_mm and thickness_std_mm", "one of them"
        raise CurveError(place, "area", expected, got, "give both, or none")
    return width * thickness, hypot(thickness * stds[0], width * stds[1])


def _source(place: str, file: _File, values: Mapping[str, Any]) -> CurveColumns | GaugeChoice:
    keys = ("load", "time", *(_OF_RESULTS if file.from_results else _OF_TABLES))
    given = {key: values[key] for key in keys if key in values}
    given |= {key: file.folder / given[key] for key in _PATHS if key in given}
    if file.from_results:
        # A value that is given without a standard deviation is exact.
        for key, std in (("offset_s", "offset_std_s"), ("clock_rate", "clock_rate_std_percent")):
            given |= {std: 0.0} if key in given and std not in given else {}
        return GaugeChoice(**given)
    without = [key for key in ("load", "strain") if key not in given]
    if without:
        expected, remedy = "a column and its unit", f'give {without[0]} = "COLUMN:UNIT", such as "Load:kN"'
        raise CurveError(place, " and ".join(without), expected, "none", remedy)
    return CurveColumns(**given)


def _caught(part: Callable[..., Part], *arguments: Any) -> tuple[Part | None, list[MeasurementError]]:
    """Call a function; return its result and no error, or None and its errors."""
    try:
        return part(*arguments), []
    except MeasurementError as error:
        return None, [error]
