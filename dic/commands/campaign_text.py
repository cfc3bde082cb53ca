"""The tables that `dic campaign` prints, at most 80 columns wide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import dic

_NAME_WIDTH, _VALUE_WIDTH, _COLUMNS = 15, 20, 3
_STATISTICS = ("mean", "std between", "standard error", "mean stated std")


def campaign_lines(campaign: dic.campaigns.Campaign) -> Iterator[str]:
    """Yield the lines of one or more tables: specimens above mean and scatter, some properties per table."""
    keys = campaign.quantities
    for first in range(0, len(keys), _COLUMNS):
        yield from _block(campaign, keys[first : first + _COLUMNS])
    yield from _outliers(campaign)
    yield from _strains(campaign)
    for name, value in campaign.anisotropy.items():
        symbol = {"r_mean": "r̄", "delta_r": "Δr"}[name]
        yield f"{symbol}: {dic.report.value_cell(value, 3) if value.value is not None else value.flags[0]}"
    if campaign.lacking:
        yield f"no specimen has: {', '.join(map(dic.report.symbol_of, campaign.lacking))}"
    if campaign.not_counted:
        yield f"± is one standard deviation, without that of: {', '.join(campaign.not_counted)}"
    flagged = sum(
        bool(value.flags) for found in campaign.found.values() for value in found.values.values()
        if value.value is not None
    )  # fmt: skip
    if flagged:
        yield f"* marks {flagged} values with flags, which --report and --json list"


def _strains(campaign: dic.campaigns.Campaign) -> Iterator[str]:
    """Yield lines with the kind of strain of each result file, and the images without a reading."""
    for kind, names in campaign.kinds.items():
        yield f"strain: {kind}, {', '.join(names)}"
    left_out = [f"{test.left_out} of {test.name}" for test in campaign.tests if test.left_out]
    if left_out:
        yield f"images without a reading: {', '.join(left_out)}"
    for warning in campaign.warnings:
        yield f"warning: {warning}"


def _block(campaign: dic.campaigns.Campaign, keys: Sequence[str]) -> Iterator[str]:
    units = [campaign.example(key).unit for key in keys]
    heads = [
        dic.report.symbol_of(key) + ("" if unit == "1" else f", {unit}")
        for key, unit in zip(keys, units, strict=True)
    ]
    yield _line("specimen", heads)
    for name, found in campaign.found.items():
        cells = []
        for key, unit in zip(keys, units, strict=True):
            value = found.values.get(key)
            known = value is not None and value.value is not None
            mark = "*" if known and value is not None and value.flags else " "
            cells.append(
                (dic.report.value_cell(value, dic.report.DECIMALS[unit]) if value is not None else "–") + mark
            )
        yield _line(name, cells)
    for group in campaign.groups:
        rows = [
            dic.report.statistics_cells(group.scatter[key]) if key in group.scatter else ["–"] * 4
            for key in keys
        ]
        if len(campaign.groups) > 1:
            yield f"{group.label}:"
        for order, title in enumerate(_STATISTICS):
            yield _line(title, [row[order] + " " for row in rows])
    yield ""


def _line(title: str, cells: Sequence[str]) -> str:
    short = title if len(title) <= _NAME_WIDTH else "…" + title[1 - _NAME_WIDTH :]
    return (f"{short:<{_NAME_WIDTH}}" + "".join(f"{cell:>{_VALUE_WIDTH}}" for cell in cells)).rstrip()


def _outliers(campaign: dic.campaigns.Campaign) -> Iterator[str]:
    """Yield a line for each outlier, or a line that says that there is none or that no test was possible."""
    told = [
        f"outlier: {dic.report.symbol_of(key)} of {dic.report.outlier_text(scatter)}, among {group.label}"
        for group in campaign.groups
        for key, scatter in group.scatter.items()
        if scatter.outlying is not None
    ]
    yield from told
    tests = [scatter.outlier for group in campaign.groups for scatter in group.scatter.values()]
    done = sum(test.place is not None for test in tests)
    reasons = dict.fromkeys(test.reason for test in tests if test.reason)
    if not told and done:
        yield f"no outlier in {done} tests after Grubbs, two-sided, 5 %"
    if not done and reasons:
        yield f"no test for outliers: {'; '.join(reasons)}"
