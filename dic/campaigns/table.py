"""The CSV table of a campaign: a line for each specimen, then the mean and scatter of each group."""

from collections.abc import Iterator
from typing import Any

from dic.campaigns.campaign import COMPARE_FIRST, Campaign, Group
from dic.errors import require_kind
from dic.results.csv import write_rows
from dic.typing import PathLike

_DIGITS = 6
STATISTICS = ("mean", "std_between", "standard_error", "stated_std")
"""Statistics of a group that get a line in the table, after the specimens; attributes of `Scatter`."""


def write_campaign_table(campaign: Campaign, path: PathLike, *, decimal_comma: bool = False) -> None:
    """Write the table of a campaign as CSV.

    `docs/campaigns.md` describes the lines and columns.

    Parameters
    ----------
    campaign : Campaign
    path : path
    decimal_comma : bool
        True for numbers with a decimal comma and semicolons between cells.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    require_kind("campaign", campaign, Campaign, COMPARE_FIRST)
    rows = [*_specimens(campaign), *(row for group in campaign.groups for row in _statistics(group))]
    columns = list(dict.fromkeys(["line", "specimen", "direction_deg", *_value_columns(campaign)]))
    columns += ["strain_kind", "left_out"] if campaign.kinds else []
    columns += ["outlier_of", "flags", "problem"]
    write_rows(path, columns, rows, _DIGITS, decimal_comma=decimal_comma)


def _value_columns(campaign: Campaign) -> Iterator[str]:
    for key in campaign.quantities:
        yield from (key, f"{key}_std")


def _specimens(campaign: Campaign) -> Iterator[dict[str, Any]]:
    """Yield the line of each specimen of the campaign, keyed by column."""
    for test in campaign.tests:
        row: dict[str, Any] = {"line": "specimen", "specimen": test.name} | _direction(test.direction_deg)
        if test.properties is None:
            yield row | {"problem": str(test.failure)}
            continue
        if test.strain_kind:
            row |= {"strain_kind": test.strain_kind, "left_out": test.left_out}
        flags = []
        for key in campaign.quantities:
            value = test.properties.values.get(key)
            if value is None or value.value is None:
                continue
            row[key] = float(value.value)
            row |= {} if value.std is None else {f"{key}_std": float(value.std)}
            flags += [f"{key}: {flag}" for flag in value.flags]
        outlying = dict.fromkeys(key for key, _ in campaign.outliers_of(test.name))
        yield row | {"flags": "; ".join(flags), "outlier_of": " ".join(outlying)}


def _statistics(group: Group) -> Iterator[dict[str, Any]]:
    """Yield the lines of a group's statistics, keyed by column."""
    about = {"specimen": group.label} | _direction(group.direction_deg)
    for line in ("count", *STATISTICS):
        values = {key: getattr(scatter, line) for key, scatter in group.scatter.items()}
        yield {"line": line} | about | {key: value for key, value in values.items() if value is not None}


def _direction(direction_deg: float | None) -> dict[str, Any]:
    return {} if direction_deg is None else {"direction_deg": f"{direction_deg:g}"}
