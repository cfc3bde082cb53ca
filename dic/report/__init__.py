"""The report: one self-contained HTML file that compares one or several runs with the paper."""

from dic.report.page import write_report

__all__ = ["write_report"]
