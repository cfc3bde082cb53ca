"""The report on a campaign: one HTML page with the tables of several specimens and their curves."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dic.campaigns.campaign import COMPARE_FIRST, Campaign, Group, SpecimenTest
from dic.campaigns.grubbs import RULE
from dic.campaigns.scatter import Scatter
from dic.errors import require_kind
from dic.files.writing import write_figure, write_text
from dic.properties.value import PropertyValue
from dic.report.numbers import fixed, with_std
from dic.report.pdf import require_pdf, write_pdf
from dic.report.style import OFF_AXIS_COLOURS, legend_below, new_figure, plot_style, png_uri
from dic.report.templating import page_templates
from dic.report.tensile_figures import beginning_of
from dic.report.tensile_page import DECIMALS, value_cell
from dic.report.tensile_record import SYMBOLS
from dic.typing import PathLike

_DASHES, _WIDTHS = ("-", "--", ":", "-."), (1.3, 2.6)
_MOST_NAMED = 40
"""A figure of more curves than this has no legend: no more styles of line can be told apart."""
_ROUNDING = 1e-12
"""Scatter of at most this part of the mean is the rounding of numbers."""
_ANISOTROPY = {"r_mean": "r̄", "delta_r": "Δr"}


@dataclass(frozen=True)
class CampaignCell:
    """A cell of the table of specimens: value, standard deviation, has the value flags, is it an outlier."""

    value: str
    std: str
    flagged: bool
    outlying: bool


@dataclass(frozen=True)
class SpecimenRow:
    """A row of the table of specimens: name, direction, strain, properties, and the reason of a failure."""

    name: str
    direction: str
    strain: str
    cells: list[CampaignCell]
    failure: str


@dataclass(frozen=True)
class ScatterRow:
    """A row of the table of a group: a property, its number of values, its statistics and its outlier."""

    symbol: str
    unit: str
    count: int
    cells: list[str]
    outlier: str


@dataclass(frozen=True)
class CampaignView:
    """The content of the report on a campaign, in the form that the page template needs."""

    title: str
    headings: list[tuple[str, str]]
    lacking: str
    warnings: list[str]
    specimens: list[SpecimenRow]
    groups: list[tuple[str, list[ScatterRow]]]
    anisotropy: list[tuple[str, str, str]]
    rule: str
    not_counted: str
    flags: list[tuple[str, list[str]]]
    rules: list[tuple[str, str, str]]
    inputs: list[tuple[str, str, str]]
    curves: str


def write_campaign_report(
    campaign: Campaign, path: PathLike, *, title: str = "Campaign", pdf: PathLike | None = None
) -> None:
    """Write the report on a campaign as one HTML file with the figure inside.

    Parameters
    ----------
    campaign : Campaign
        From `compare_specimens` or `measure_campaign`.
    path : path
    title : str
    pdf : path, optional
        The same page as a PDF file. This needs the extra ``offaxis[pdf]``.

    Raises
    ------
    OSError
        If a file cannot be written.
    OutputError
        If `pdf` is given and WeasyPrint is not installed.
    """
    require_kind("campaign", campaign, Campaign, COMPARE_FIRST)
    if pdf is not None:
        require_pdf(pdf)
    with plot_style():
        view = _view(campaign, title)
    page: str = page_templates().get_template("campaign.html.j2").render(view=view)
    write_text(path, page)
    if pdf is not None:
        write_pdf(page, pdf)


def plot_campaign(campaign: Campaign, path: PathLike) -> None:
    """Write the curves of all specimens in one picture.

    Parameters
    ----------
    campaign : Campaign
    path : path
        The ending determines the format, such as .png or .pdf.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    require_kind("campaign", campaign, Campaign, COMPARE_FIRST)
    with plot_style():
        write_figure(_curves(campaign), path, 130)


def _view(campaign: Campaign, title: str) -> CampaignView:
    keys = campaign.quantities
    return CampaignView(
        title=title,
        headings=[(symbol_of(key), _unit(campaign.example(key))) for key in keys],
        lacking=", ".join(map(symbol_of, campaign.lacking)),
        warnings=campaign.warnings,
        specimens=[_specimen(campaign, test, keys) for test in campaign.tests],
        groups=[(group.label, _scatter_rows(group)) for group in campaign.groups],
        anisotropy=[
            (_ANISOTROPY[name], value_cell(value, 3), value.rule + _reasons(value))
            for name, value in campaign.anisotropy.items()
        ],
        rule=RULE,
        not_counted=", ".join(campaign.not_counted),
        flags=[(name, _flags(campaign, name, keys)) for name in campaign.found],
        rules=[(symbol_of(key), SYMBOLS.get(key, ("", ""))[1], campaign.example(key).rule) for key in keys],
        inputs=[(test.name, Path(test.file).name, test.sha256) for test in campaign.tests if test.file],
        curves=png_uri(_curves(campaign), dpi=130),
    )


def symbol_of(key: str) -> str:
    """Return the symbol of a property from its key, such as "Rp0,2" from "Rp02_mpa"."""
    return SYMBOLS[key][0] if key in SYMBOLS else key.partition("_")[0]


def _unit(value: PropertyValue | Scatter) -> str:
    return "" if value.unit == "1" else value.unit


def _reasons(value: PropertyValue) -> str:
    return f"; {'; '.join(value.flags)}" if value.value is None else ""


def _specimen(campaign: Campaign, test: SpecimenTest, keys: Sequence[str]) -> SpecimenRow:
    direction = "" if test.direction_deg is None else f"{test.direction_deg:g}°"
    if test.properties is None:
        return SpecimenRow(test.name, direction, "", [], str(test.failure))
    outlying = {key for key, _ in campaign.outliers_of(test.name)}
    cells = []
    for key in keys:
        value = test.properties.values.get(key)
        if value is None or value.value is None:
            cells.append(CampaignCell("–", "", flagged=False, outlying=False))
        else:
            number, _, std = value_cell(value, DECIMALS[value.unit]).partition(" ± ")
            cells.append(CampaignCell(number, std, bool(value.flags), key in outlying))
    left_out = f", without {test.left_out} images" if test.left_out else ""
    return SpecimenRow(test.name, direction, test.strain_kind + left_out, cells, "")


def _flags(campaign: Campaign, name: str, keys: Sequence[str]) -> list[str]:
    """Return the objections to the values of a specimen, one sentence each."""
    found = campaign.found[name]
    of_values = {key: found.values[key] for key in keys if key in found.values}
    own = [f"{symbol_of(key)}: {flag}" for key, value in of_values.items() for flag in value.flags]
    return own + found.flags


def _scatter_rows(group: Group) -> list[ScatterRow]:
    return [
        ScatterRow(symbol_of(key), _unit(found), found.count, statistics_cells(found), outlier_text(found))
        for key, found in group.scatter.items()
    ]


def statistics_cells(scatter: Scatter) -> list[str]:
    """Return the statistics of a property as text, in the order of `dic.campaigns.table.STATISTICS`."""
    digits = DECIMALS[scatter.unit]
    mean = "–" if scatter.mean is None else fixed(scatter.mean, digits)
    # The values have about 16 digits. So the scatter of equal values is not always exactly zero.
    least = _ROUNDING * abs(scatter.mean or 0.0)
    from_scatter = [
        0.0 if std is not None and std <= least else std
        for std in (scatter.std_between, scatter.standard_error)
    ]
    return [mean, *(_std_text(std, digits) for std in (*from_scatter, scatter.stated_std))]


def _std_text(std: float | None, digits: int) -> str:
    """Return a standard deviation as text, with two significant digits if it would be rounded to zero."""
    if std is None:
        return "–"
    rounded_to_zero = std > 0.0 and round(std, digits) == 0.0
    return with_std(0.0, std).partition(" ± ")[2] if rounded_to_zero else fixed(std, digits)


def outlier_text(scatter: Scatter) -> str:
    """Return the result of Grubbs' test for outliers in words."""
    test = scatter.outlier
    if test.place is None or test.statistic is None or test.critical is None:
        return f"not tested: {test.reason}"
    compared = f"G = {test.statistic:.3f}, critical {test.critical:.3f}"
    return f"{scatter.names[test.place]} ({compared})" if test.is_outlier else f"none ({compared})"


def _curves(campaign: Campaign) -> Any:
    """Return a figure of stress against strain of all specimens: the whole curves, and their beginnings."""
    figure, axes = new_figure(2, 4.6)
    ends = []
    named = len(campaign.found) <= _MOST_NAMED
    colours, dashes = len(OFF_AXIS_COLOURS), len(_DASHES)
    for order, (name, found) in enumerate(campaign.found.items()):
        record, elastic = found.record, found.elastic
        foot = elastic.foot if elastic is not None else 0.0
        style = {
            "color": OFF_AXIS_COLOURS[order % colours],
            "linestyle": _DASHES[(order // colours) % dashes],
            "linewidth": _WIDTHS[(order // (colours * dashes)) % len(_WIDTHS)],
        }
        for axis in axes:
            strain = 100.0 * (record.strain - foot)
            axis.plot(strain, record.strained_stress, label=name if named else None, **style)
        reach, top = beginning_of(found)
        ends.append((reach - 100.0 * foot, top))
    figure.subplots_adjust(top=0.93)
    axes[0].set_title("whole curves")
    axes[1].set_title("beginning")
    reach, top = max(end[0] for end in ends), max(end[1] for end in ends)
    axes[1].set(xlim=(-0.02 * reach, reach), ylim=(0.0, top))
    for axis in axes:
        axis.set(xlabel="strain after correction of the foot, %", ylabel="stress, MPa")
    if named:
        legend_below(figure, columns=len(campaign.found))
    return figure
