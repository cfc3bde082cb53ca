"""The report: one HTML file with all figures; it compares runs with Helm and Deaner's paper."""

from dic.report.page import write_report

__all__ = ["write_report"]
