"""Write down which tests were skipped, for another machine to run: `pytest @FILE`. A plugin of pytest."""

from pathlib import Path
from typing import Any

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--skipped-file", type=Path, help="append the name of every skipped test to it")


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    path = config.getoption("skipped_file")
    # the workers of xdist end with a summary, too, which nobody sees
    if path is not None and not hasattr(config, "workerinput"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.writelines(f"{report.nodeid}\n" for report in terminalreporter.stats.get("skipped", ()))
