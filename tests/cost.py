"""What the tests cost: processor time by test, fixture and file. A plugin of pytest for `make test-cost`.

The time is that of the worker and of the programs that it started and waited for, so that it is the same on a
busy computer. A fixture of a module or session is counted once, where the first test asked for it.
"""

import os
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import pytest

DEAREST = 40
"""Number of rows in each printed table."""

_costs = pytest.StashKey[dict[str, float]]()


def processor_s() -> float:
    """Return the processor time in s of this process and of the child processes that have ended."""
    return sum(os.times()[:4])


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--cost-file", type=Path, help="also write the processor time of every test as CSV")


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(
    fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest
) -> Generator[None, object, object]:
    before = processor_s()
    try:
        return (yield)
    finally:
        # the item of a fixture of a module is the module; the test that asked for it bears the cost
        item = request._pyfuncitem
        name = f"{fixturedef.argname} ({fixturedef.baseid or 'pytest'}, {fixturedef.scope})"
        costs = item.stash.setdefault(_costs, {})
        costs[name] = costs.get(name, 0.0) + processor_s() - before


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    return (yield from _timed(item, "setup"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    return (yield from _timed(item, "call"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, object, object]:
    """Hand the test's costs to the controller, with the report of its end."""
    try:
        return (yield from _timed(item, "teardown"))
    finally:
        item.user_properties.append(("cost", item.stash[_costs]))


def _timed(item: pytest.Item, phase: str) -> Generator[None, object, object]:
    before = processor_s()
    try:
        return (yield)
    finally:
        item.stash.setdefault(_costs, {})[phase] = processor_s() - before


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print the dearest tests, fixtures and files; the sum is that of all tests."""
    if hasattr(config, "workerinput"):
        return
    tests: dict[str, float] = {}
    fixtures: dict[str, float] = defaultdict(float)
    files: dict[str, float] = defaultdict(float)
    reports = (report for group in terminalreporter.stats.values() for report in group)
    for report in reports:
        if getattr(report, "when", None) != "teardown" and not getattr(report, "failed", False):
            continue
        costs = dict(dict(getattr(report, "user_properties", ())).get("cost", {}))
        if not costs:
            continue
        whole = sum(costs.pop(phase, 0.0) for phase in ("setup", "call", "teardown"))
        tests[report.nodeid] = whole
        files[report.nodeid.partition("::")[0]] += whole
        for name, cost in costs.items():
            fixtures[name] += cost
    for title, rows in ("test", tests), ("fixture", fixtures), ("file", files):
        terminalreporter.section(f"processor time by {title}, {sum(rows.values()):.0f} s in all")
        for name, cost in _dearest(rows.items())[:DEAREST]:
            terminalreporter.write_line(f"{cost:8.2f} s  {name}")
    if path := config.getoption("cost_file"):
        lines = (f'{cost:.3f},"{name}"\n' for name, cost in _dearest(tests.items()))
        path.write_text("processor_s,test\n" + "".join(lines))


def _dearest(rows: Iterable[tuple[str, float]]) -> list[tuple[str, float]]:
    return sorted(rows, key=lambda row: -row[1])
