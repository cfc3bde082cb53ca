"""The report: one self-contained HTML file of one or several runs, beside what the paper reported."""

from dic.report.page import write_report

__all__ = ["write_report"]
