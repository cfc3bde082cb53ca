"""The tables and figures of a tensile test in the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.properties.plot import draw_properties
from dic.properties.value import PropertyValue
from dic.report.camera_images import Results, images_of
from dic.report.conditions import StatedConditions, conditions_of
from dic.report.numbers import fixed, with_std
from dic.report.repeat import Repeat, repeat_of, result_of
from dic.report.style import PAGE_WIDTH_IN, PICTURE_DPI, png_uri, svg_uri
from dic.report.tables import Remarks
from dic.report.tensile_figures import curves_figure, gauges_figure
from dic.report.tensile_record import TensileColumn, TensileTest, symbols_of

_ALWAYS = ("E_gpa", "nu", "Rp02_mpa")
_IDENTITY = {
    "Laboratory": ("laboratory", "Name"),
    "Report": ("laboratory", "Number of the report"),
    "Order": ("laboratory", "Order"),
    "Operator": ("laboratory", "Operator"),
    "Date of the test": ("laboratory", "Date of the test"),
    "Specimen": ("specimen", "Name"),
    "Material": ("specimen", "Material"),
    "Condition": ("specimen", "Condition"),
    "Testing machine": ("machine", "Model"),
}
"""Name, table and row of each fact above the values of a test."""
_CURVE_HEIGHT_IN = 4.2
DECIMALS = {"GPa": 2, "MPa": 1, "%": 3, "1": 4}


@dataclass(frozen=True)
class PropertyRow:
    """A row of the table of properties: a property, one value per column, the known value and the rule."""

    symbol: str
    name: str
    unit: str
    cells: list[str]
    known: str
    differences: list[str]
    rule: str


@dataclass(frozen=True)
class TensileView:
    """The content of the report on one tensile test, in the form that the page template needs."""

    test: TensileTest
    identity: list[tuple[str, str]]
    not_counted: str
    headings: list[tuple[str, str]]
    rows: list[PropertyRow]
    remarks: list[Remarks]
    about: list[tuple[str, str]]
    curves: str
    curve: str
    gauges: str
    conditions: StatedConditions
    repeat: Repeat


def tensile_view(test: TensileTest, results: Sequence[Results]) -> TensileView:
    """Return the tables and figures of a tensile test; call this function within `plot_style`.

    Raises `MeasurementError` if the test is not one of the results, or its details do not fit them.
    """
    result, symbols = result_of(test, results), symbols_of(test.settings)
    conditions = conditions_of(test, result, images_of(result))
    return TensileView(
        test=test,
        identity=_identity(conditions),
        not_counted=", ".join(
            dict.fromkeys(part for column in test.columns for part in column.properties.not_counted)
        ),
        headings=[(column.camera, column.kind_text) for column in test.columns],
        rows=[_row(test, name, *words) for name, words in symbols.items() if _is_shown(test, name)],
        remarks=remarks_of(test),
        about=_about(test),
        curves=svg_uri(curves_figure(test)),
        curve=png_uri(_properties_figure(test), PICTURE_DPI),
        gauges=svg_uri(gauges_figure(test)),
        conditions=conditions,
        repeat=repeat_of(test, result),
    )


def _identity(conditions: StatedConditions) -> list[tuple[str, str]]:
    """Return the known facts that identify a test, which stand above its values."""
    stated = {name: dict(table.facts) for name, table in conditions.tables.stated.items()}
    found = [(label, stated[table][row][0]) for label, (table, row) in _IDENTITY.items()]
    return [(label, fact.text) for label, fact in found if fact.is_known]


def _properties_figure(test: TensileTest) -> Any:
    figure = draw_properties(test.main.properties)
    figure.set_size_inches(PAGE_WIDTH_IN, _CURVE_HEIGHT_IN)
    return figure


def _is_shown(test: TensileTest, name: str) -> bool:
    values = [column.properties.values[name].value for column in test.columns]
    return name in _ALWAYS or any(value is not None for value in values)


def _row(test: TensileTest, name: str, symbol: str, words: str) -> PropertyRow:
    values = [column.properties.values[name] for column in test.columns]
    known = test.known.get(name)
    unit = values[0].unit
    digits = DECIMALS[unit]
    differences = []
    for value in values:
        share = None if known is None or value.value is None else 100.0 * (value.value / known - 1.0)
        differences.append("" if share is None else f"{'+' if share >= 0 else ''}{fixed(share, 2)} %")
    return PropertyRow(
        symbol=symbol,
        name=words,
        unit="" if unit == "1" else unit,
        cells=[value_cell(value, digits) for value in values],
        known="" if known is None else fixed(known, digits),
        differences=differences,
        rule=values[-1].rule,
    )


def value_cell(value: PropertyValue, digits: int) -> str:
    """Return a value with its standard deviation as text; a dash if there is no value."""
    if value.value is None:
        return "–"
    return fixed(value.value, digits) if not value.std else with_std(value.value, value.std)


def remarks_of(test: TensileTest) -> list[Remarks]:
    """Return the objections to the values: first those to all columns, then those to single columns."""
    own = [_remarks(test, column) for column in test.columns]
    if len(own) == 1:
        return [Remarks(test.main.label, own[0])]
    shared = [sentence for sentence in own[0] if all(sentence in each for each in own)]
    apart = [
        Remarks(column.label, [sentence for sentence in each if sentence not in shared])
        for column, each in zip(test.columns, own, strict=True)
    ]
    return [Remarks("All columns", shared), *apart]


def _remarks(test: TensileTest, column: TensileColumn) -> list[str]:
    """Return the objections to the values of a column, and the reason for each value that is missing."""
    found, sentences = column.properties, []
    for name, (symbol, _) in symbols_of(found.settings).items():
        value = found.values[name]
        if _is_shown(test, name):
            sentences += [f"{symbol}: {flag}" for flag in value.flags]
    sentences += found.flags + found.time_texts
    if found.not_counted:
        sentences.append(f"± is without the standard deviation of: {', '.join(found.not_counted)}")
    if column.read.left_out:
        sentences.append(f"{column.read.left_out} images have no reading")
    return sentences


def _about(test: TensileTest) -> list[tuple[str, str]]:
    settings = test.settings
    area = f"{settings.area_mm2:g} mm²"
    rows = [("Area S0", area + (f" ± {settings.area_std_mm2:g} mm²" if settings.area_std_mm2 else ""))]
    if settings.load_std_percent:
        rows.append(("Load cell, one standard deviation", f"{settings.load_std_percent:g} % of the load"))
    if test.joined is not None:
        rows.append(("Load from the machine's record", test.joined.text))
    for gauge in test.series.gauges:
        use = {test.gauge: "along the specimen", test.transverse: "across the specimen"}.get(gauge.name)
        if use is None:
            continue
        lengths = _lengths(test, gauge.name)
        text = f"{gauge.kind}, gauge length {lengths}" if lengths else gauge.kind
        rows.append((f"Gauge “{gauge.name}”, {use}", text))
    return rows


def _lengths(test: TensileTest, name: str) -> str:
    """Return the gauge lengths between the measured points in the images of each camera, as text."""
    found: dict[str, dict[str, list[float]]] = {}
    for image in test.series.images:
        if name in image.readings:
            _, reading = image.best(name)
            if not reading.reason and np.isfinite(reading.length):
                of_camera = found.setdefault(str(image.known.get("camera", "")), {})
                of_camera.setdefault(reading.unit, []).append(reading.length)
    return "; ".join(
        f"{_range_text(lengths)} {unit}{f' ({camera})' if camera else ''}"
        for camera, of_camera in found.items()
        for unit, lengths in of_camera.items()
    )


def _range_text(values: list[float]) -> str:
    low, high = fixed(min(values), 3), fixed(max(values), 3)
    return low if low == high else f"{low} to {high}"
